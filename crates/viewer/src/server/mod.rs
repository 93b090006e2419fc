//! The HTTP server, in its own thread, and its connections: a WebSocket for each client, and files on request.

mod routes;
mod socket;

use std::collections::HashMap;
use std::io;
use std::net::{self, IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::{sleep, timeout};
use tokio_io_timeout::TimeoutStream;

use routes::routes;
pub(crate) use routes::{App, Guard};

/// Time for open connections to end.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// A listening socket and its address: that of this machine alone unless one is given.
pub(crate) fn listen(bind: Option<IpAddr>, port: u16) -> Result<(net::TcpListener, SocketAddr)> {
    let address = SocketAddr::new(bind.unwrap_or(Ipv4Addr::LOCALHOST.into()), port);
    let listener = net::TcpListener::bind(address);
    let listener = listener
        .with_context(|| format!("{address}: expected a free port (--port 0: any) at an address of this machine"))?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    Ok((listener, address))
}

/// The address by which others reach a socket that listens at `address`: where that is any address of this machine, the one
/// from which it reaches others.
pub(crate) fn reachable(address: SocketAddr) -> SocketAddr {
    if !address.ip().is_unspecified() {
        return address;
    }
    let own = |from: IpAddr, to: IpAddr| -> io::Result<IpAddr> {
        // Nothing is sent: connecting a datagram socket only chooses its address. These addresses are for documentation.
        let socket = UdpSocket::bind((from, 0))?;
        socket.connect((to, 9))?;
        Ok(socket.local_addr()?.ip())
    };
    let v4 = own(Ipv4Addr::UNSPECIFIED.into(), Ipv4Addr::new(192, 0, 2, 1).into());
    let v6 = || own(Ipv6Addr::UNSPECIFIED.into(), Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1).into());
    let found = if address.is_ipv4() { v4 } else { v6().or(v4) };
    SocketAddr::new(found.unwrap_or(Ipv4Addr::LOCALHOST.into()), address.port())
}

/// A running server.
pub(crate) struct Server {
    app: Arc<App>,
    thread: JoinHandle<io::Result<()>>,
}

impl Server {
    pub(crate) fn start(listener: net::TcpListener, app: App) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let app = Arc::new(app);
        let shared = Arc::clone(&app);
        let serve = move || runtime.block_on(run(listener, shared));
        Ok(Self { app, thread: std::thread::Builder::new().name("server".to_owned()).spawn(serve)? })
    }

    /// Closes all connections and ends the thread.
    pub(crate) fn stop(self) -> Result<()> {
        self.app.queue.stop();
        self.app.stopping.send_replace(true);
        Ok(self.thread.join().map_err(|_| anyhow::anyhow!("the server ended unexpectedly"))??)
    }
}

async fn run(listener: net::TcpListener, app: Arc<App>) -> io::Result<()> {
    let listener = TcpListener::from_std(listener)?;
    serve(listener, routes(&app), app.stopping.subscribe()).await?;
    tokio::select! {
        () = app.stopping.closed() => {}
        () = sleep(CLOSE_TIMEOUT) => {}
    }
    Ok(())
}

/// Connections that are served at a time, WebSockets not counted; further ones wait until one ends.
const MAX_SERVED: usize = 64;
/// Connections that are open at a time.
const MAX_OPEN: usize = 192;
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

/// How long a client may receive nothing while there is something to send.
const STALL_TIMEOUT: Duration = Duration::from_secs(8);

/// Serves until `stopping` is true; open connections hold a clone of it until they have ended.
pub(crate) async fn serve(
    listener: TcpListener,
    routes: Router,
    mut stopping: watch::Receiver<bool>,
) -> io::Result<()> {
    let (open, served) = (Arc::new(Semaphore::new(MAX_OPEN)), Arc::new(Semaphore::new(MAX_SERVED)));
    let shares = AddressShares::default();
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .max_header_size(MAX_HEAD_BYTES)
        .max_headers(MAX_HEAD_LINES);
    loop {
        let (place, stream, address) = tokio::select! {
            accepted = accept(&listener, &open) => accepted?,
            _ = stopping.wait_for(|&stopping| stopping) => return Ok(()),
        };
        let Some(share) = shares.open(address) else { continue };
        // Frames are sent at once, not together with the next one.
        let _ = stream.set_nodelay(true);
        let mut stream = Box::pin(TimeoutStream::new(stream));
        stream.as_mut().set_write_timeout_pinned(Some(STALL_TIMEOUT));
        let service = TowerToHyperService::new(routes.clone());
        let connection = http.serve_connection(TokioIo::new(stream), service).with_upgrades();
        let (mut stopping, served) = (stopping.clone(), Arc::clone(&served));
        tokio::spawn(async move {
            // First of the address, so that those that wait take no place from other addresses.
            let places = async { (share.served.acquire().await, served.acquire().await) };
            let stopped = async { drop(stopping.clone().wait_for(|&stopping| stopping).await) };
            let places = tokio::select! {
                places = places => places,
                () = stopped => return,
            };
            let mut connection = pin!(connection);
            let stop = async { drop(stopping.wait_for(|&stopping| stopping).await) };
            // Errors of the connection mean that the client has left.
            tokio::select! {
                _ = timeout(CONNECTION_TIMEOUT, connection.as_mut()) => return drop((places, place)),
                () = stop => connection.as_mut().graceful_shutdown(),
            }
            let _ = connection.await;
        });
    }
}

/// The next connection, once it may be open.
async fn accept(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
) -> io::Result<(OwnedSemaphorePermit, TcpStream, IpAddr)> {
    let place = Arc::clone(places).acquire_owned().await.map_err(io::Error::other)?;
    loop {
        match listener.accept().await {
            Ok((stream, address)) => return Ok((place, stream, address.ip())),
            Err(_) => sleep(RETRY).await,
        }
    }
}

/// Connections of an address that are served at a time.
const MAX_SERVED_OF_ADDRESS: usize = 48;
/// Connections of an address that are open at a time; those that are not served wait.
const MAX_OPEN_OF_ADDRESS: usize = 96;

/// The connections of each address that has any.
#[derive(Debug, Clone, Default)]
struct AddressShares(Arc<Mutex<HashMap<IpAddr, Share>>>);

#[derive(Debug)]
struct Share {
    open: usize,
    served: Arc<Semaphore>,
}

/// An open connection, which counts until it is dropped.
#[derive(Debug)]
struct OpenConnection {
    shares: AddressShares,
    address: IpAddr,
    /// A permit is needed to be served.
    served: Arc<Semaphore>,
}

impl AddressShares {
    fn lock(&self) -> MutexGuard<'_, HashMap<IpAddr, Share>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a connection; `None` if the address has as many as it may.
    fn open(&self, address: IpAddr) -> Option<OpenConnection> {
        let mut shares = self.lock();
        let new = || Share { open: 0, served: Arc::new(Semaphore::new(MAX_SERVED_OF_ADDRESS)) };
        let share = shares.entry(address).or_insert_with(new);
        if share.open >= MAX_OPEN_OF_ADDRESS {
            return None;
        }
        share.open += 1;
        Some(OpenConnection { shares: self.clone(), address, served: Arc::clone(&share.served) })
    }
}

impl Drop for OpenConnection {
    fn drop(&mut self) {
        let mut shares = self.shares.lock();
        if let Some(share) = shares.get_mut(&self.address) {
            share.open -= 1;
        }
        shares.retain(|_, share| share.open > 0);
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;
    use std::time::Instant;

    use axum::body::Bytes;
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpSocket;

    use super::*;

    /// Sends a request from an address of this machine; the client reads no more than a few bytes
    /// ahead.
    async fn request(from: [u8; 4], server: SocketAddr) -> io::Result<TcpStream> {
        let socket = TcpSocket::new_v4()?;
        socket.set_recv_buffer_size(4096)?;
        socket.bind(SocketAddr::from((from, 0)))?;
        let mut stream = socket.connect(server).await?;
        stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").await?;
        Ok(stream)
    }

    /// Whether the server answers.
    async fn is_answered(from: [u8; 4], server: SocketAddr) -> bool {
        let answer = async { request(from, server).await?.read_exact(&mut [0; 12]).await };
        timeout(Duration::from_secs(2), answer).await.is_ok_and(|answer| answer.is_ok())
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn clients_that_do_not_read_leave_room_for_others_and_lose_their_places() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let server = listener.local_addr().unwrap();
            let body = Bytes::from(vec![0; 32 << 20]);
            let routes = Router::new().route("/", get(move || async move { body.clone() }));
            let (stop, stopping) = watch::channel(false);
            let serving = tokio::spawn(serve(listener, routes, stopping));
            let mut idle = Vec::new();
            for _ in 0..MAX_SERVED {
                idle.push(request([127, 0, 0, 1], server).await.unwrap());
            }
            assert!(is_answered([127, 0, 0, 2], server).await, "another address");
            let started = Instant::now();
            while !is_answered([127, 0, 0, 1], server).await {
                assert!(started.elapsed() < Duration::from_secs(20));
                sleep(Duration::from_millis(100)).await;
            }
            drop(idle);
            stop.send_replace(true);
            serving.await.unwrap().unwrap();
        });
    }
}
