//! Routes of the server: the page, the WebSocket, photos, and pictures to save.

use std::net::IpAddr;
use std::path::Path as FilePath;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use axum::Router;
use axum::extract::{DefaultBodyLimit, FromRequest, Path, Request, State, WebSocketUpgrade};
use axum::http::header::{HOST, HeaderName, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use liveview::image::encode;
use liveview_synthesizer::Scene;
use tokio::sync::{Semaphore, watch};
use tokio::time::timeout;

use super::socket::{self, Limits, MAX_BYTES, viewpoint};
use crate::requests::{FileError, FileRequest, RequestQueue};

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

/// The state that all connections share.
pub(crate) struct App {
    pub(crate) queue: Arc<RequestQueue>,
    pub(crate) scene: Scene,
    /// Time steps of a rig; `None` for a scene of photos.
    pub(crate) steps: Option<usize>,
    /// The first message to each client, JSON.
    pub(crate) session_info: String,
    pub(crate) guard: Guard,
    /// Held while a photo is read: one at a time.
    pub(crate) reading: Semaphore,
    pub(crate) stopping: watch::Sender<bool>,
}

impl App {
    /// `steps`: the time steps of a rig.
    pub(crate) fn new(
        queue: Arc<RequestQueue>,
        scene: Scene,
        steps: Option<usize>,
        session_info: String,
        guard: Guard,
    ) -> Self {
        let (reading, stopping) = (Semaphore::new(1), watch::Sender::new(false));
        Self { queue, scene, steps, session_info, guard, reading, stopping }
    }

    /// What clients may request.
    pub(crate) fn limits(&self) -> Limits<'_> {
        Limits { views: self.scene.views.iter().map(|view| &view.camera).collect(), steps: self.steps.unwrap_or(1) }
    }
}

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const TOKEN_BYTES: usize = 16;

/// The conditions that a request must meet.
#[derive(Debug)]
pub(crate) struct Guard {
    /// Part of the link if the server is bound to an address of the user's choice.
    token: Option<String>,
}

impl Guard {
    /// `bind`: the address given; without one only requests to a local host name are accepted.
    pub(crate) fn new(bind: Option<IpAddr>) -> Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| anyhow::anyhow!("no random numbers for a token: {error}"))?;
        Ok(Self { token: bind.map(|_| bytes.iter().map(|byte| format!("{byte:02x}")).collect()) })
    }

    /// The part of the link after the address.
    pub(crate) fn query(&self) -> String {
        self.token.as_ref().map(|token| format!("?token={token}")).unwrap_or_default()
    }

    /// Checks a request; an error is the reason for which it is refused.
    pub(crate) fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), &'static str> {
        let header = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
        let host = header(HOST).unwrap_or_default();
        // DNS rebinding, by which another site sends requests here, shows in Host. With a token any host name is accepted.
        if self.token.is_none() && !is_local(host) {
            return Err("Host: expected 127.0.0.1 or localhost");
        }
        if header(ORIGIN).is_some_and(|origin| !origin.eq_ignore_ascii_case(&format!("http://{host}"))) {
            return Err("Origin: another page may not use this server");
        }
        if header(FETCH_SITE).is_some_and(|site| site != "same-origin" && site != "none") {
            return Err("Sec-Fetch-Site: another page may not use this server");
        }
        match &self.token {
            Some(token) if !has_token(uri, token) => {
                Err("expected the link that `liveview view` printed, with its token")
            }
            _ => Ok(()),
        }
    }
}

/// Whether a Host header names this machine; the port may differ behind a tunnel.
fn is_local(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    ["127.0.0.1", "localhost", "[::1]"].iter().any(|local| local.eq_ignore_ascii_case(name))
}

/// Whether the query holds the token; compared in constant time.
fn has_token(uri: &Uri, token: &str) -> bool {
    let given = uri.query().unwrap_or_default().split('&').find_map(|pair| pair.strip_prefix("token="));
    let given = given.unwrap_or_default().as_bytes();
    let differing = given.iter().zip(token.as_bytes()).fold(0, |bits, (a, b)| bits | (a ^ b));
    given.len() == token.len() && differing == 0
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn is_accepted(guard: &Guard, uri: &str, given: &[(&'static str, &'static str)]) -> bool {
        let headers =
            given.iter().map(|&(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value)));
        guard.check(&uri.parse().unwrap(), &headers.collect()).is_ok()
    }

    #[test]
    fn without_bind_only_local_hosts_and_same_origin_are_accepted() {
        let guard = Guard::new(None).unwrap();
        assert_eq!(guard.query(), "");
        for host in ["127.0.0.1:8090", "localhost:8090", "LOCALHOST:8090", "localhost", "[::1]:8090"] {
            assert!(is_accepted(&guard, "/", &[("host", host)]), "{host}");
        }
        for host in ["", "evil.example", "127.0.0.1.evil.example:8090", "localhost:evil", "192.168.1.2:8090"] {
            assert!(!is_accepted(&guard, "/", &[("host", host)]), "{host}");
        }
        let host = ("host", "localhost:8090");
        for (name, value, expected) in [
            ("origin", "http://localhost:8090", true),
            ("origin", "http://localhost:9000", false),
            ("origin", "https://localhost:8090", false),
            ("origin", "null", false),
            ("sec-fetch-site", "none", true),
            ("sec-fetch-site", "cross-site", false),
            ("sec-fetch-site", "same-site", false),
        ] {
            assert_eq!(is_accepted(&guard, "/socket", &[host, (name, value)]), expected, "{name}: {value}");
        }
    }

    #[test]
    fn with_bind_the_token_is_required() {
        let guard = Guard::new(Some([0, 0, 0, 0].into())).unwrap();
        let query = guard.query();
        assert_eq!(query.len(), "?token=".len() + 2 * TOKEN_BYTES);
        assert_ne!(query, Guard::new(Some([0, 0, 0, 0].into())).unwrap().query());
        let host = [("host", "studio:8090")];
        assert!(is_accepted(&guard, &format!("/{query}"), &host));
        assert!(is_accepted(&guard, &format!("/photo/1{query}&x=1"), &host));
        for wrong in ["/", "/?token=", "/?token=0", &format!("/{query}0"), &format!("/{}", &query[..query.len() - 1])] {
            assert!(!is_accepted(&guard, wrong, &host), "{wrong}");
        }
        let foreign = [host[0], ("origin", "http://evil.example")];
        assert!(!is_accepted(&guard, &format!("/{query}"), &foreign));
    }
}
