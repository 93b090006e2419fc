//! The HTTP server: the page, the socket, photos, and pictures to save. A thread of its own; the renderer has another.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path as FilePath;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use axum::extract::{DefaultBodyLimit, FromRequest, Path, Request, State, WebSocketUpgrade};
use axum::http::{HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use liveview::Scene;
use liveview::image::encode;
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};

use super::desk::Desk;
use super::guard::Guard;
use super::message::{MAX_BYTES, Range, moment};
use super::wish::Asked;
use super::{http, page, socket};

/// Largest message that is read at all; one over [`MAX_BYTES`] is refused with a reason.
const MAX_READ: usize = 1 << 16;
/// Time to send what is asked for.
const BODY_TIME: Duration = Duration::from_secs(10);
/// Time that connections have to end.
const FAREWELL: Duration = Duration::from_secs(1);

/// What all connections share.
pub(super) struct App {
    pub(super) desk: Arc<Desk>,
    scene: Scene,
    /// Time steps of a rig.
    steps: Option<usize>,
    /// The first message to each client.
    pub(super) hello: String,
    guard: Guard,
    /// Photos that are read at a time.
    reading: Semaphore,
    stopping: watch::Sender<bool>,
}

impl App {
    /// `steps`: the time steps of a rig.
    pub(super) fn new(desk: Arc<Desk>, scene: Scene, steps: Option<usize>, hello: String, guard: Guard) -> Self {
        Self { desk, scene, steps, hello, guard, reading: Semaphore::new(1), stopping: watch::Sender::new(false) }
    }

    /// What clients may ask for.
    pub(super) fn range(&self) -> Range<'_> {
        Range { views: self.scene.views.iter().map(|view| &view.camera).collect(), steps: self.steps.unwrap_or(1) }
    }
}

/// A socket that listens, and its address; only this machine can reach it unless an address is given.
pub(super) fn listen(bind: Option<IpAddr>, port: u16) -> Result<(TcpListener, SocketAddr)> {
    let address = SocketAddr::new(bind.unwrap_or(Ipv4Addr::LOCALHOST.into()), port);
    let listener = TcpListener::bind(address);
    let listener =
        listener.with_context(|| format!("{address}: expected a free port of this machine (--port 0: any)"))?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    Ok((listener, address))
}

/// A server that runs.
pub(super) struct Server {
    app: Arc<App>,
    thread: JoinHandle<io::Result<()>>,
}

impl Server {
    pub(super) fn start(listener: TcpListener, app: App) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let app = Arc::new(app);
        let shared = Arc::clone(&app);
        let serve = move || runtime.block_on(run(listener, shared));
        Ok(Self { app, thread: std::thread::Builder::new().name("server".to_owned()).spawn(serve)? })
    }

    /// Ends all connections, and the thread.
    pub(super) fn stop(self) -> Result<()> {
        self.app.desk.stop();
        self.app.stopping.send_replace(true);
        Ok(self.thread.join().map_err(|_| anyhow::anyhow!("the server ended unexpectedly"))??)
    }
}

async fn run(listener: TcpListener, app: Arc<App>) -> io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let routes = Router::new()
        .route("/socket", get(open_socket))
        .route("/photo/{view}", get(photo))
        .route("/picture", post(picture))
        .route("/", get(|| async { page::file("index.html") }))
        .layer(from_fn_with_state(Arc::clone(&app), guarded))
        // Nothing in these is secret, and a page asks for them without the token.
        .route("/page/{file}", get(|Path(name): Path<String>| async move { page::file(&name) }))
        .layer(DefaultBodyLimit::max(MAX_BYTES))
        .with_state(Arc::clone(&app));
    http::serve(listener, routes, app.stopping.subscribe()).await?;
    tokio::select! {
        () = app.stopping.closed() => {}
        () = sleep(FAREWELL) => {}
    }
    Ok(())
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
