//! The HTTP server: the page, the socket, photos, and pictures to save. A thread of its own; the renderer has another.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path as FilePath;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use axum::extract::{DefaultBodyLimit, Path, Request, State, WebSocketUpgrade};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::serve::ListenerExt;
use liveview::image::encode;
use liveview::{Camera, Scene};
use tokio::sync::{Semaphore, watch};
use tokio::time::sleep;

use super::desk::Desk;
use super::guard::Guard;
use super::message::{self, MAX_BYTES};
use super::{page, socket};

/// Largest message that is read at all; one over [`MAX_BYTES`] is refused with a reason.
const MAX_READ: usize = 1 << 16;
/// Time that connections have to end.
const FAREWELL: Duration = Duration::from_secs(1);

/// What all connections share.
pub(super) struct App {
    pub(super) desk: Arc<Desk>,
    pub(super) scene: Scene,
    /// The first message to each client.
    pub(super) hello: String,
    guard: Guard,
    /// Photos that are read at a time.
    reading: Semaphore,
    stopping: watch::Sender<bool>,
}

impl App {
    pub(super) fn new(desk: Arc<Desk>, scene: Scene, hello: String, guard: Guard) -> Self {
        Self { desk, scene, hello, guard, reading: Semaphore::new(1), stopping: watch::Sender::new(false) }
    }

    /// The cameras of all views.
    pub(super) fn cameras(&self) -> Vec<&Camera> {
        self.scene.views.iter().map(|view| &view.camera).collect()
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
    let listener = tokio::net::TcpListener::from_std(listener)?.tap_io(|stream| {
        // A frame must not wait for the next one.
        let _ = stream.set_nodelay(true);
    });
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
    let stopping = || {
        let mut stopping = app.stopping.subscribe();
        async move { drop(stopping.wait_for(|&stopping| stopping).await) }
    };
    tokio::select! {
        served = axum::serve(listener, routes).with_graceful_shutdown(stopping()) => served?,
        () = async { stopping().await; sleep(FAREWELL).await } => {}
    }
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

/// A photo as the renderer sees it: undistorted, at the size of its camera.
async fn photo(State(app): State<Arc<App>>, Path(view): Path<usize>) -> Response {
    let views = app.scene.views.len();
    if view >= views {
        return (StatusCode::NOT_FOUND, format!("expected a view from 0 to {}\n", views - 1)).into_response();
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
async fn picture(State(app): State<Arc<App>>, body: String) -> Response {
    let refused = |reason: String| (StatusCode::BAD_REQUEST, format!("{reason}\n")).into_response();
    let entry = match serde_json::from_str(&body) {
        Ok(entry) => entry,
        Err(error) => return refused(format!("not JSON: {error}")),
    };
    let camera = match message::camera(&entry, &app.cameras()) {
        Ok(camera) => camera,
        Err(reason) => return refused(reason),
    };
    let Some(saved) = app.desk.still(camera) else {
        return (StatusCode::SERVICE_UNAVAILABLE, "other pictures are still being made\n").into_response();
    };
    match saved.await {
        Ok(Ok(png)) => ([(header::CONTENT_TYPE, "image/png")], axum::body::Bytes::from_owner(png)).into_response(),
        Ok(Err(reason)) => refused(reason),
        Err(_) => (StatusCode::SERVICE_UNAVAILABLE, "the program has ended\n").into_response(),
    }
}
