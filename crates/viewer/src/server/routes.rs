//! Routes of the server: the page, the WebSocket, photos, and pictures to save.

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

use super::app::App;
use super::message::{MAX_BYTES, viewpoint};
use super::socket;
use crate::request::{FileError, FileRequest};

/// Largest message that is read; one above [`MAX_BYTES`] is refused with a reason.
const MAX_READ_BYTES: usize = 1 << 16;
/// Time to receive the body of a request.
const BODY_TIMEOUT: Duration = Duration::from_secs(10);

/// All routes. All but the files of the page are behind the guard.
pub(crate) fn routes(app: &Arc<App>) -> Router {
    Router::new()
        .route("/socket", get(open_socket))
        .route("/photo/{view}", get(photo))
        .route("/picture", post(picture))
        .route("/", get(|| async { page_file("index.html") }))
        .layer(from_fn_with_state(Arc::clone(app), guarded))
        // These hold no secrets, and the page requests them without the token.
        .route("/page/{file}", get(|Path(name): Path<String>| async move { page_file(&name) }))
        .layer(DefaultBodyLimit::max(MAX_BYTES))
        .with_state(Arc::clone(app))
}

async fn guarded(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    if let Err(reason) = app.guard.check(request.uri(), request.headers()) {
        return (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(SECURITY_POLICY));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

async fn open_socket(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    let alive = app.stopping.subscribe();
    let upgrade = upgrade.max_message_size(MAX_READ_BYTES).max_frame_size(MAX_READ_BYTES);
    upgrade.on_upgrade(|socket| socket::serve(socket, app, alive))
}

/// The time step in a query, such as `step=3`.
fn step(uri: &Uri) -> Option<usize> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("step="))?.parse().ok()
}

/// A photo, undistorted, at the size of its camera; for a rig at the time step in the query.
async fn photo(State(app): State<Arc<App>>, Path(view): Path<usize>, uri: Uri) -> Response {
    let views = app.scene.views.len();
    if view >= views {
        return (StatusCode::NOT_FOUND, format!("expected a view from 0 to {}\n", views - 1)).into_response();
    }
    if let Some(steps) = app.steps {
        let Some(step) = step(&uri).filter(|&step| step < steps) else {
            return (StatusCode::NOT_FOUND, format!("expected ?step= from 0 to {}\n", steps - 1)).into_response();
        };
        return rendered_file(&app, FileRequest::Photo { view, step }, "image/jpeg").await;
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

/// A picture at full quality, the same that `liveview render --pose` writes.
async fn picture(State(app): State<Arc<App>>, request: Request) -> Response {
    let body = match timeout(BODY_TIMEOUT, String::from_request(request, &())).await {
        Ok(Ok(body)) => body,
        Ok(Err(refused)) => return refused.into_response(),
        Err(_) => return StatusCode::REQUEST_TIMEOUT.into_response(),
    };
    let parsed = serde_json::from_str(&body).map_err(|error| format!("not JSON: {error}"));
    match parsed.and_then(|parsed| viewpoint(&parsed, &app.limits())) {
        Ok(viewpoint) => rendered_file(&app, FileRequest::Picture(viewpoint), "image/png").await,
        Err(reason) => refused(reason),
    }
}

/// A file from the renderer.
async fn rendered_file(app: &App, request: FileRequest, kind: &'static str) -> Response {
    let answer = match app.queue.request_file(request) {
        Some(answer) => answer.await,
        None => Ok(Err(FileError::TooMany)),
    };
    match answer {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, kind)], axum::body::Bytes::from_owner(bytes)).into_response(),
        Ok(Err(FileError::Failed(reason))) => refused(reason),
        Ok(Err(FileError::TooMany)) => {
            (StatusCode::SERVICE_UNAVAILABLE, "too many pictures are requested at once\n").into_response()
        }
        Err(_) => (StatusCode::SERVICE_UNAVAILABLE, "the program has ended\n").into_response(),
    }
}

fn refused(reason: String) -> Response {
    (StatusCode::BAD_REQUEST, format!("{reason}\n")).into_response()
}

/// Content security policy: the page loads nothing from elsewhere, and no other page may embed it.
const SECURITY_POLICY: &str =
    "default-src 'self'; img-src 'self' blob: data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'";

const FILES: [(&str, &str, &str); 9] = [
    ("index.html", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("view.css", "text/css; charset=utf-8", include_str!("page/view.css")),
    ("view.js", SCRIPT, include_str!("page/view.js")),
    ("rig.js", SCRIPT, include_str!("page/rig.js")),
    ("input.js", SCRIPT, include_str!("page/input.js")),
    ("link.js", SCRIPT, include_str!("page/link.js")),
    ("panel.js", SCRIPT, include_str!("page/panel.js")),
    ("player.js", SCRIPT, include_str!("page/player.js")),
    ("recorder.js", SCRIPT, include_str!("page/recorder.js")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// A file of the page.
fn page_file(name: &str) -> Response {
    match FILES.iter().find(|(known, ..)| *known == name) {
        Some(&(_, kind, text)) => {
            ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-cache")], text).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}
