//! The WebSocket of one client: receives requests, sends frames.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::{self, CloseFrame, WebSocket, close_code};
use tokio::sync::{mpsc, watch};
use tokio::time::{interval, timeout};

use super::app::App;
use super::limits::MessageRate;
use super::message::{ClientMessage, Limits, MAX_BYTES, parse};
use crate::request::Message;

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
