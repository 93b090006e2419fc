//! The WebSocket of one client: receives requests, sends frames.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::{self, CloseFrame, WebSocket, close_code};
use liveview::Camera;
use liveview_scene::cameras::camera_from_json;
use serde_json::Value;
use tokio::sync::{mpsc, watch};
use tokio::time::{interval, timeout};

use super::routes::App;
use crate::requests::{Message, ViewRequest, Viewpoint};

/// Time between pings.
const PING_INTERVAL: Duration = Duration::from_secs(3);
/// Pings in a row without any message of the client after which it counts as gone.
const MAX_UNANSWERED_PINGS: usize = 3;
/// Time for a client to receive a message.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Time for a client to receive the reason for which it is disconnected.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(500);

/// The close code and the reason for which a client is disconnected.
type CloseReason = (u16, String);

/// Serves a client until it leaves, violates the protocol, or the program ends. `_alive` is held for that time.
pub(crate) async fn serve(mut socket: WebSocket, app: Arc<App>, _alive: watch::Receiver<bool>) {
    let close_reason = match app.queue.join() {
        None => Some((close_code::AGAIN, "too many viewers are open; close one".to_owned())),
        Some((client, mut messages)) => {
            let close_reason = exchange(&mut socket, &app, client, &mut messages).await;
            app.queue.leave(client);
            close_reason
        }
    };
    if let Some((code, mut reason)) = close_reason {
        // A close frame holds 125 bytes.
        reason.truncate(reason.floor_char_boundary(120));
        let _ = timeout(CLOSE_TIMEOUT, close(&mut socket, CloseFrame { code, reason: reason.into() })).await;
    }
}

/// Sends the reason and reads until the client has closed too: unread messages would discard the reason.
async fn close(socket: &mut WebSocket, reason: CloseFrame) {
    if socket.send(ws::Message::Close(Some(reason))).await.is_ok() {
        while let Some(Ok(_)) = socket.recv().await {}
    }
}

/// Exchanges messages with a client; `None` once it has left.
async fn exchange(
    socket: &mut WebSocket,
    app: &App,
    client: u64,
    messages: &mut mpsc::Receiver<Message>,
) -> Option<CloseReason> {
    send(socket, ws::Message::Text(app.session_info.as_str().into())).await?;
    let limits = app.limits();
    let (mut rate, mut ping, mut unanswered) = (MessageRate::new(Instant::now()), interval(PING_INTERVAL), 0);
    loop {
        tokio::select! {
            message = messages.recv() => match message {
                None => return Some((close_code::AWAY, "the program has ended".to_owned())),
                Some(Message::Frame(frame)) => send(socket, ws::Message::Binary(Bytes::from_owner(frame))).await?,
                Some(Message::Text(text)) => send(socket, ws::Message::Text(text.into())).await?,
            },
            received = socket.recv() => {
                unanswered = 0;
                if !rate.allows(Instant::now()) {
                    return Some((close_code::POLICY, "too many messages a second".to_owned()));
                }
                if let Some(ended) = receive(received?, app, client, &limits).transpose() {
                    return ended.err();
                }
            }
            _ = ping.tick() => {
                unanswered += 1;
                if unanswered > MAX_UNANSWERED_PINGS {
                    return None;
                }
                send(socket, ws::Message::Ping(Bytes::new())).await?;
            }
        }
    }
}

/// Sends a message; `None` if the client has left or receives nothing.
async fn send(socket: &mut WebSocket, message: ws::Message) -> Option<()> {
    timeout(SEND_TIMEOUT, socket.send(message)).await.ok()?.ok()
}

/// Handles a message; `Ok(Some)`: the client has closed.
fn receive(
    received: Result<ws::Message, axum::Error>,
    app: &App,
    client: u64,
    limits: &Limits<'_>,
) -> Result<Option<()>, CloseReason> {
    let text = match received {
        Ok(ws::Message::Text(text)) => text,
        Ok(ws::Message::Binary(_)) => {
            return Err((close_code::UNSUPPORTED, "expected text, not binary data".to_owned()));
        }
        Ok(ws::Message::Ping(_) | ws::Message::Pong(_)) => return Ok(None),
        Ok(ws::Message::Close(_)) => return Ok(Some(())),
        Err(error) => return Err((close_code::PROTOCOL, error.to_string())),
    };
    if text.len() > MAX_BYTES {
        return Err((close_code::SIZE, format!("a message of {} bytes; expected at most {MAX_BYTES}", text.len())));
    }
    match parse(&text, limits).map_err(|error| (close_code::POLICY, error))? {
        ClientMessage::View(request) => app.queue.request_view(client, request),
        ClientMessage::Shown => app.queue.frame_shown(client),
    }
    Ok(None)
}

/// Largest message, bytes.
pub(crate) const MAX_BYTES: usize = 4096;

/// Messages per second that are allowed in the long run.
const PER_SECOND: f64 = 200.0;
/// Messages that are allowed at once.
const BURST: f64 = 200.0;

/// A token bucket.
#[derive(Debug)]
struct MessageRate {
    tokens: f64,
    filled_at: Instant,
}

impl MessageRate {
    fn new(now: Instant) -> Self {
        Self { tokens: BURST, filled_at: now }
    }

    /// Counts a message; whether it is allowed.
    fn allows(&mut self, now: Instant) -> bool {
        self.tokens = (self.tokens + PER_SECOND * (now - self.filled_at).as_secs_f64()).min(BURST);
        self.filled_at = now;
        self.tokens -= 1.0;
        self.tokens >= 0.0
    }
}

/// A message of a client.
#[derive(Debug)]
pub(crate) enum ClientMessage {
    View(ViewRequest),
    /// The client has shown a frame.
    Shown,
}

/// What clients may request.
#[derive(Debug)]
pub(crate) struct Limits<'a> {
    /// Cameras of the photos: a requested picture is no larger than these.
    pub(crate) views: Vec<&'a Camera>,
    /// Time steps; 1 for a scene of photos.
    pub(crate) steps: usize,
}

/// Parses a message; an error says what was expected.
pub(crate) fn parse(text: &str, limits: &Limits<'_>) -> Result<ClientMessage, String> {
    let message: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let number = |key: &str| message[key].as_u64().ok_or_else(|| format!("{key}: expected a whole number"));
    let flag = |key: &str| message[key].as_bool().ok_or_else(|| format!("{key}: expected true or false"));
    if message.get("shown").is_some() {
        return number("shown").map(|_| ClientMessage::Shown);
    }
    if message.get("camera").is_none() {
        return Err("expected \"camera\" or \"shown\"".to_owned());
    }
    let (id, moving, depth) = (number("id")?, flag("moving")?, flag("depth")?);
    Ok(ClientMessage::View(ViewRequest { id, viewpoint: viewpoint(&message, limits)?, moving, depth }))
}

/// Reads `camera` and, for a rig, `step` (default: the first).
pub(crate) fn viewpoint(message: &Value, limits: &Limits<'_>) -> Result<Viewpoint, String> {
    let last = limits.steps - 1;
    let step = match message.get("step") {
        None => Some(0),
        Some(step) => step.as_u64().and_then(|step| usize::try_from(step).ok()).filter(|&step| step <= last),
    };
    let step = step.ok_or_else(|| format!("step: expected a time step from 0 to {last}"))?;
    Ok(Viewpoint { camera: camera(&message["camera"], &limits.views)?, step })
}

/// Reads a camera in the format of `render --pose`, no larger than the photos.
fn camera(entry: &Value, views: &[&Camera]) -> Result<Camera, String> {
    let camera = camera_from_json(entry, views)?;
    let max_side = views.iter().map(|view| view.width().max(view.height())).max().unwrap_or(0);
    if camera.width().max(camera.height()) > max_side {
        let (width, height) = (camera.width(), camera.height());
        return Err(format!("w, h: {width}x{height} is larger than the photos; expected sides of at most {max_side}"));
    }
    let max_pixels = views.iter().map(|view| view.size().pixels()).max().unwrap_or(0);
    if camera.size().pixels() > max_pixels {
        let (width, height) = (camera.width(), camera.height());
        return Err(format!("w, h: {width}x{height} is larger than the photos; expected at most {max_pixels} pixels"));
    }
    Ok(camera)
}

#[cfg(test)]
mod tests {
    use liveview::Intrinsics;
    use liveview::glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn invalid_message_error_names_the_field() {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let view = Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let limits = Limits { views: vec![&view], steps: 3 };
        let pose = r#""cam_from_world": [[1,0,0,0.5],[0,1,0,0],[0,0,1,0]]"#;
        let message = |camera: &str| format!(r#"{{"id": 3, "moving": true, "depth": false, "camera": {{{camera}}}}}"#);
        let Ok(ClientMessage::View(request)) = parse(&message(pose), &limits) else { panic!() };
        assert_eq!((request.id, request.moving, request.depth), (3, true, false));
        assert_eq!((request.viewpoint.camera.translation().x, request.viewpoint.step), (0.5, 0));
        let later = message(pose).replace("\"id\"", "\"step\": 2, \"id\"");
        let Ok(ClientMessage::View(request)) = parse(&later, &limits) else { panic!() };
        assert_eq!(request.viewpoint.step, 2);
        assert!(matches!(parse(r#"{"shown": 4}"#, &limits), Ok(ClientMessage::Shown)));
        for (text, word) in [
            ("", "not JSON"),
            (&"[".repeat(4000), "not JSON"),
            ("[]", "camera"),
            (r#"{"shown": -1}"#, "shown"),
            (r#"{"camera": {}}"#, "id"),
            (r#"{"camera": {}, "id": 1, "moving": 1}"#, "moving"),
            (&message(""), "cam_from_world"),
            (&message(&format!("{pose}, \"w\": 64, \"h\": 64")), "at most 3072 pixels"),
            (&message(&format!("{pose}, \"w\": 300, \"h\": 10")), "sides of at most 64"),
            (&message(&format!("{pose}, \"fl_x\": 1e999")), "not JSON"),
            (&message(&pose.replace("1,0,0", "2,0,0")), "rotation"),
            (&later.replace(": 2", ": 3"), "step: expected a time step from 0 to 2"),
            (&later.replace(": 2", ": -1"), "step"),
            (&later.replace(": 2", ": 1e300"), "step"),
        ] {
            let refused = parse(text, &limits).unwrap_err();
            assert!(refused.contains(word), "{word}: {refused}");
        }
    }

    #[test]
    fn a_burst_is_allowed_then_the_long_term_rate() {
        let start = Instant::now();
        let mut rate = MessageRate::new(start);
        assert!((0..200).all(|_| rate.allows(start)));
        assert!(!rate.allows(start));
        let mut rate = MessageRate::new(start);
        assert!((0..10_000).all(|i| rate.allows(start + Duration::from_millis(6 * i))));
    }
}
