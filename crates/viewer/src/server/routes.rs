//! Routes of the server: the page, photos, their depth, and pictures at full quality.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, FromRequest, Path, Request, State};
use axum::http::{HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use liveview::Camera;
use liveview_live::rig::Frames;
use liveview_scene::cameras::camera_from_json;
use liveview_synthesizer::Scene;
use serde_json::Value;
use tokio::sync::{Semaphore, watch};
use tokio::time::timeout;

use super::jobs::{Answer, Jobs, KeptFiles, PhotoKey, Viewpoint};
use super::{Guard, source};

/// Largest body of a request, bytes.
const MAX_BYTES: usize = 4096;
/// Time to receive it.
const BODY_TIMEOUT: Duration = Duration::from_secs(10);
/// Time for a depth to be found; the page asks again.
const DEPTH_TIMEOUT: Duration = Duration::from_secs(60);

/// The state that all connections share.
pub(crate) struct App {
    pub(crate) jobs: Arc<Jobs>,
    pub(crate) scene: Scene,
    /// Views without depth.
    pub(crate) held_out: Vec<usize>,
    /// The photos of a rig.
    pub(crate) frames: Option<Arc<Frames>>,
    /// Time steps; 1 for a scene of photos.
    pub(crate) steps: usize,
    pub(crate) page: String,
    pub(crate) guard: Guard,
    /// Takes notes for the user.
    pub(crate) note: fn(&str),
    /// Photos that were sent.
    pub(crate) photos: Mutex<KeptFiles>,
    /// Held while a photo is read: one at a time.
    pub(crate) reading: Semaphore,
    pub(crate) stopping: watch::Sender<bool>,
    /// Number of pages sent.
    pub(crate) viewers: Arc<AtomicU64>,
}

/// All routes, behind the guard.
pub(crate) fn routes(app: &Arc<App>) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/photo/{view}", get(photo))
        .route("/depth/{view}", get(depth))
        .route("/picture", post(picture))
        .route("/moment", get(moment))
        .layer(from_fn_with_state(Arc::clone(app), guarded))
        .layer(DefaultBodyLimit::max(MAX_BYTES))
        .with_state(Arc::clone(app))
}

async fn guarded(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    if let Err(reason) = app.guard.check(request.uri(), request.headers()) {
        return (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    // The page's own policy says what it may load; this one also holds for what else is opened.
    let policy = "frame-ancestors 'none'; base-uri 'none'";
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, policy),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn page(State(app): State<Arc<App>>) -> Response {
    app.viewers.fetch_add(1, Ordering::Relaxed);
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], app.page.clone()).into_response()
}

impl App {
    /// The photo that a request names, by its view and for a rig by the time step in the query, such as `step=3`.
    /// `None` if there is none.
    fn key(&self, view: usize, uri: &Uri) -> Option<PhotoKey> {
        let given = uri.query().and_then(|query| query.split('&').find_map(|pair| pair.strip_prefix("step=")));
        let step = given.map_or(Some(0), |step| step.parse().ok())?;
        (view < self.scene.views.len() && step < self.steps).then_some((view, step))
    }
}

/// A photo, undistorted, at the size of its camera.
async fn photo(State(app): State<Arc<App>>, Path(view): Path<usize>, uri: Uri) -> Response {
    let Some(key) = app.key(view, &uri) else { return StatusCode::NOT_FOUND.into_response() };
    let Ok(_permit) = app.reading.acquire().await else { return StatusCode::SERVICE_UNAVAILABLE.into_response() };
    let photos = || app.photos.lock().unwrap_or_else(PoisonError::into_inner);
    let kept = photos().get(key);
    if let Some(kept) = kept {
        return answer::<()>(Ok(Ok(kept)), "image/jpeg");
    }
    let (scene, frames) = (app.scene.clone(), app.frames.clone());
    let read = tokio::task::spawn_blocking(move || source::photo(&scene, frames.as_deref(), key)).await;
    let read = read.map_err(anyhow::Error::from).flatten().map(Arc::<[u8]>::from);
    if let Ok(jpeg) = &read {
        photos().insert(key, Arc::clone(jpeg));
    }
    // Of a camera that runs and delivers nothing, it would be said at each step.
    let failed = |error: anyhow::Error| match app.steps {
        usize::MAX => (),
        _ => (app.note)(&format!("a photo could not be sent: {error:#}")),
    };
    answer::<()>(Ok(read.map_err(failed)), "image/jpeg")
}

/// The last time step of cameras that run.
async fn moment(State(app): State<Arc<App>>) -> Response {
    let Some(frames) = app.frames.clone() else { return StatusCode::NOT_FOUND.into_response() };
    let step = tokio::task::spawn_blocking(move || frames.take()).await;
    step.map_or(StatusCode::SERVICE_UNAVAILABLE.into_response(), |step| step.to_string().into_response())
}

/// The depth of a photo, once it is found.
async fn depth(State(app): State<Arc<App>>, Path(view): Path<usize>, uri: Uri) -> Response {
    let key = app.key(view, &uri).filter(|_| !app.held_out.contains(&view));
    match key.map(|key| app.jobs.depth(key)) {
        Some(Some(found)) => match timeout(DEPTH_TIMEOUT, found).await {
            Ok(found) => answer(found, "application/octet-stream"),
            Err(_) => StatusCode::SERVICE_UNAVAILABLE.into_response(),
        },
        Some(None) => too_many(),
        None => StatusCode::NOT_FOUND.into_response(),
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
    match parsed.and_then(|parsed| viewpoint(&parsed, &app)) {
        Ok(viewpoint) => match app.jobs.picture(viewpoint) {
            Some(picture) => answer(picture.await, "image/png"),
            None => too_many(),
        },
        Err(reason) => (StatusCode::BAD_REQUEST, format!("{reason}\n")).into_response(),
    }
}

/// A file; an error says nothing of this machine, the program's output does.
fn answer<E>(file: Result<Answer, E>, kind: &'static str) -> Response {
    match file {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, kind)], Bytes::from_owner(bytes)).into_response(),
        Ok(Err(())) => (StatusCode::INTERNAL_SERVER_ERROR, "failed; `liveview view` has printed why\n").into_response(),
        Err(_) => (StatusCode::SERVICE_UNAVAILABLE, "the program has ended\n").into_response(),
    }
}

fn too_many() -> Response {
    (StatusCode::SERVICE_UNAVAILABLE, "too many requests wait\n").into_response()
}

/// Reads `camera`, in the format of `render --pose` and no larger than the photos, and for a rig `step` (default: the
/// first).
fn viewpoint(message: &Value, app: &App) -> Result<Viewpoint, String> {
    let last = app.steps - 1;
    let step = match message.get("step") {
        None => Some(0),
        Some(step) => step.as_u64().and_then(|step| usize::try_from(step).ok()).filter(|&step| step <= last),
    };
    let step = step.ok_or_else(|| format!("step: expected a time step from 0 to {last}"))?;
    let views: Vec<&Camera> = app.scene.views.iter().map(|view| &view.camera).collect();
    let camera = camera_from_json(&message["camera"], &views)?;
    let most = |of: fn(&Camera) -> usize| views.iter().map(|view| of(view)).max().unwrap_or(0);
    let (side, pixels) = (most(|view| view.width().max(view.height())), most(|view| view.size().pixels()));
    if camera.width().max(camera.height()) > side || camera.size().pixels() > pixels {
        let (width, height) = (camera.width(), camera.height());
        return Err(format!(
            "w, h: {width}x{height} is larger than the photos; expected sides of at most {side}, and {pixels} pixels"
        ));
    }
    Ok(Viewpoint { camera, step })
}
