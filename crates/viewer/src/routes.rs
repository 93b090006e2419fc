//! What the server answers: the page, the socket, photos, and pictures to save.

use std::path::Path as FilePath;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{DefaultBodyLimit, FromRequest, Path, Request, State, WebSocketUpgrade};
use axum::http::{HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use liveview::image::encode;
use tokio::time::timeout;

use crate::app::App;
use crate::message::{MAX_BYTES, moment};
use crate::wish::Asked;
use crate::{page, socket};

/// Largest message that is read at all; one over [`MAX_BYTES`] is refused with a reason.
const MAX_READ: usize = 1 << 16;
/// Time to send what is asked for.
const BODY_TIME: Duration = Duration::from_secs(10);

/// All routes, behind the guard.
pub(crate) fn routes(app: &Arc<App>) -> Router {
    Router::new()
        .route("/socket", get(open_socket))
        .route("/photo/{view}", get(photo))
        .route("/picture", post(picture))
        .route("/", get(|| async { page::file("index.html") }))
        .layer(from_fn_with_state(Arc::clone(app), guarded))
        // Nothing in these is secret, and a page asks for them without the token.
        .route("/page/{file}", get(|Path(name): Path<String>| async move { page::file(&name) }))
        .layer(DefaultBodyLimit::max(MAX_BYTES))
        .with_state(Arc::clone(app))
}

async fn guarded(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    if let Err(reason) = app.guard.check(request.uri(), request.headers()) {
        return (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(page::POLICY));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

async fn open_socket(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    let alive = app.stopping.subscribe();
    let upgrade = upgrade.max_message_size(MAX_READ).max_frame_size(MAX_READ);
    upgrade.on_upgrade(|socket| socket::serve(socket, app, alive))
}

/// The time step of a query: `step=3`, among others.
fn step(uri: &Uri) -> Option<usize> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("step="))?.parse().ok()
}

/// A photo as the renderer sees it: undistorted, at the size of its camera. Of a rig that of the time step in the query.
async fn photo(State(app): State<Arc<App>>, Path(view): Path<usize>, uri: Uri) -> Response {
    let views = app.scene.views.len();
    if view >= views {
        return (StatusCode::NOT_FOUND, format!("expected a view from 0 to {}\n", views - 1)).into_response();
    }
    if let Some(steps) = app.steps {
        let Some(step) = step(&uri).filter(|&step| step < steps) else {
            return (StatusCode::NOT_FOUND, format!("expected ?step= from 0 to {}\n", steps - 1)).into_response();
        };
        return asked(&app, Asked::Photo { view, step }, "image/jpeg").await;
    }
    let Ok(_permit) = app.reading.acquire().await else { return StatusCode::SERVICE_UNAVAILABLE.into_response() };
    let scene = app.scene.clone();
    let read = move || {
        scene.load_image(view).map_err(anyhow::Error::from).and_then(|p| Ok(encode(FilePath::new("photo.jpg"), &p)?))
    };
    match tokio::task::spawn_blocking(read).await {
        Ok(Ok(jpeg)) => ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response(),
        Ok(Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error:#}\n")).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// The picture of a camera, as `liveview render --pose` writes it.
async fn picture(State(app): State<Arc<App>>, request: Request) -> Response {
    let body = match timeout(BODY_TIME, String::from_request(request, &())).await {
        Ok(Ok(body)) => body,
        Ok(Err(refused)) => return refused.into_response(),
        Err(_) => return StatusCode::REQUEST_TIMEOUT.into_response(),
    };
    let wanted = serde_json::from_str(&body).map_err(|error| format!("not JSON: {error}"));
    match wanted.and_then(|wanted| moment(&wanted, &app.range())) {
        Ok(at) => asked(&app, Asked::Picture(at), "image/png").await,
        Err(reason) => refused(reason),
    }
}

/// A file that the renderer makes.
async fn asked(app: &App, asked: Asked, kind: &'static str) -> Response {
    let Some(answer) = app.desk.ask(asked) else {
        return (StatusCode::SERVICE_UNAVAILABLE, "others are still being served\n").into_response();
    };
    match answer.await {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, kind)], axum::body::Bytes::from_owner(bytes)).into_response(),
        Ok(Err(reason)) => refused(reason),
        Err(_) => (StatusCode::SERVICE_UNAVAILABLE, "the program has ended\n").into_response(),
    }
}

fn refused(reason: String) -> Response {
    (StatusCode::BAD_REQUEST, format!("{reason}\n")).into_response()
}
