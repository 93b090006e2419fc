//! One client's WebSocket: its wishes in, frames out.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::{self, CloseFrame, WebSocket, close_code};
use tokio::sync::{mpsc, watch};
use tokio::time::{interval, timeout};

use crate::app::App;
use crate::message::{MAX_BYTES, Range, Request, parse};
use crate::rate::Rate;
use crate::wish::Message;

/// Time between questions whether the client is still there; after two without an answer it is not.
const PING: Duration = Duration::from_secs(30);
/// Time that a client has to take a message.
const TAKEN: Duration = Duration::from_secs(60);
/// Time that a client has to hear why it is closed.
const FAREWELL: Duration = Duration::from_millis(500);

/// Why a connection ends.
type End = (u16, String);

/// Serves a client until it leaves, misbehaves, or the program ends. `_alive`: held as long.
pub(crate) async fn serve(mut socket: WebSocket, app: Arc<App>, _alive: watch::Receiver<bool>) {
    let end = match app.desk.join() {
        None => Some((close_code::AGAIN, "too many viewers are open; close one".to_owned())),
        Some((client, mut messages)) => {
            let end = talk(&mut socket, &app, client, &mut messages).await;
            app.desk.leave(client);
            end
        }
    };
    if let Some((code, mut reason)) = end {
        // A close frame holds 125 bytes.
        reason.truncate(reason.floor_char_boundary(120));
        let _ = timeout(FAREWELL, farewell(&mut socket, CloseFrame { code, reason: reason.into() })).await;
    }
}

/// Says why, and reads on until the client has closed too: what is unread would have the reason thrown away.
async fn farewell(socket: &mut WebSocket, why: CloseFrame) {
    if socket.send(ws::Message::Close(Some(why))).await.is_ok() {
        while let Some(Ok(_)) = socket.recv().await {}
    }
}

/// `None`: the client is gone.
async fn talk(socket: &mut WebSocket, app: &App, client: u64, messages: &mut mpsc::Receiver<Message>) -> Option<End> {
    send(socket, ws::Message::Text(app.hello.as_str().into())).await?;
    let range = app.range();
    let (mut rate, mut ping, mut silent) = (Rate::new(Instant::now()), interval(PING), 0);
    loop {
        tokio::select! {
            message = messages.recv() => match message {
                None => return Some((close_code::AWAY, "the program has ended".to_owned())),
                Some(Message::Frame(frame)) => send(socket, ws::Message::Binary(Bytes::from_owner(frame))).await?,
                Some(Message::Text(text)) => send(socket, ws::Message::Text(text.into())).await?,
            },
            received = socket.recv() => {
                silent = 0;
                if !rate.allows(Instant::now()) {
                    return Some((close_code::POLICY, "too many messages a second".to_owned()));
                }
                if let Some(end) = take(received?, app, client, &range).transpose() {
                    return end.err();
                }
            }
            _ = ping.tick() => {
                silent += 1;
                if silent > 3 {
                    return None;
                }
                send(socket, ws::Message::Ping(Bytes::new())).await?;
            }
        }
    }
}

/// `None`: the client is gone, or takes nothing.
async fn send(socket: &mut WebSocket, message: ws::Message) -> Option<()> {
    timeout(TAKEN, socket.send(message)).await.ok()?.ok()
}

/// Takes a message; `Ok(Some)`: the client has closed.
fn take(
    received: Result<ws::Message, axum::Error>,
    app: &App,
    client: u64,
    range: &Range<'_>,
) -> Result<Option<()>, End> {
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
    match parse(&text, range).map_err(|wrong| (close_code::POLICY, wrong))? {
        Request::Look(wish) => app.desk.wish(client, wish),
        Request::Shown => app.desk.shown(client),
    }
    Ok(None)
}
