//! Connections: how many there may be, and how long each may take.

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

/// Connections at a time, without those that have become sockets; more wait until one ends.
const CONNECTIONS: usize = 64;
/// Time for the head of a request, and between two requests.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Bytes of a head.
const HEAD_BYTES: usize = 16 << 10;
/// Lines of a head.
const HEAD_LINES: usize = 64;
/// Time for all requests of a connection. Only who has the link can be sent more than a socket's buffer holds, and read it slowly.
const LONGEST: Duration = Duration::from_secs(600);
/// Time after which a connection is accepted again, if none could be: the process may have too many files open.
const AGAIN: Duration = Duration::from_millis(100);

/// Serves until `stopping` is true; connections that are still there then hold a clone of it until they have ended.
pub(crate) async fn serve(
    listener: TcpListener,
    routes: Router,
    mut stopping: watch::Receiver<bool>,
) -> io::Result<()> {
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).max_header_size(HEAD_BYTES).max_headers(HEAD_LINES);
    loop {
        let (place, stream) = tokio::select! {
            accepted = accept(&listener, &places) => accepted?,
            _ = stopping.wait_for(|&stopping| stopping) => return Ok(()),
        };
        // A frame must not wait for the next one.
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(routes.clone());
        let connection = http.serve_connection(TokioIo::new(stream), service).with_upgrades();
        let mut stopping = stopping.clone();
        tokio::spawn(async move {
            let mut connection = pin!(connection);
            let stop = async { drop(stopping.wait_for(|&stopping| stopping).await) };
            // Whoever is cut off may have gone already.
            tokio::select! {
                _ = timeout(LONGEST, connection.as_mut()) => return drop(place),
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
            Err(_) => sleep(AGAIN).await,
        }
    }
}
