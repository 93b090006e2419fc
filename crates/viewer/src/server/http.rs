//! HTTP connections, limited in number and in time.

use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::{sleep, timeout};

/// Connections at a time, WebSockets not counted; further ones wait until one ends.
const MAX_CONNECTIONS: usize = 64;
/// Time to receive the head of a request, and between two requests.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Bytes of a request's head.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Header lines of a request.
const MAX_HEAD_LINES: usize = 64;
/// Time for all requests of a connection: a client with the link may read a long answer slowly.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(600);
/// Time before accepting again after a failure, such as too many open files.
const RETRY: Duration = Duration::from_millis(100);

/// Serves until `stopping` is true; open connections hold a clone of it until they have ended.
pub(crate) async fn serve(
    listener: TcpListener,
    routes: Router,
    mut stopping: watch::Receiver<bool>,
) -> io::Result<()> {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .max_header_size(MAX_HEAD_BYTES)
        .max_headers(MAX_HEAD_LINES);
    loop {
        let (place, stream) = tokio::select! {
            accepted = accept(&listener, &places) => accepted?,
            _ = stopping.wait_for(|&stopping| stopping) => return Ok(()),
        };
        // Frames are sent at once, not together with the next one.
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(routes.clone());
        let connection = http.serve_connection(TokioIo::new(stream), service).with_upgrades();
        let mut stopping = stopping.clone();
        tokio::spawn(async move {
            let mut connection = pin!(connection);
            let stop = async { drop(stopping.wait_for(|&stopping| stopping).await) };
            // Errors of the connection mean that the client has left.
            tokio::select! {
                _ = timeout(CONNECTION_TIMEOUT, connection.as_mut()) => return drop(place),
                () = stop => connection.as_mut().graceful_shutdown(),
            }
            let _ = connection.await;
        });
    }
}

/// The next connection, once there is a place for it.
async fn accept(listener: &TcpListener, places: &Arc<Semaphore>) -> io::Result<(OwnedSemaphorePermit, TcpStream)> {
    let place = Arc::clone(places).acquire_owned().await.map_err(io::Error::other)?;
    loop {
        match listener.accept().await {
            Ok((stream, _)) => return Ok((place, stream)),
            Err(_) => sleep(RETRY).await,
        }
    }
}
