//! The HTTP server, in its own thread, and its connections.

mod guard;
mod jobs;
mod routes;
mod source;
pub(crate) mod viewer;

use std::io;
use std::net::{self, IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::{oneshot, watch};
use tokio::time::{sleep, timeout};
use tokio_io_timeout::TimeoutStream;

pub(crate) use guard::Guard;
pub(crate) use routes::App;
use routes::routes;

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

/// Connections at a time, of an address and in all: a further one takes the place of the one that has been idle longest.
const MAX_OF_ADDRESS: usize = 192;
const MAX_OPEN: usize = 384;
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
    let connections = Connections::default();
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .max_header_size(MAX_HEAD_BYTES)
        .max_headers(MAX_HEAD_LINES);
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            _ = stopping.wait_for(|&stopping| stopping) => return Ok(()),
        };
        let Ok((stream, address)) = accepted else {
            sleep(RETRY).await;
            continue;
        };
        let Some((place, replaced)) = connections.open(address.ip()) else { continue };
        let _ = stream.set_nodelay(true);
        let mut stream = Box::pin(TimeoutStream::new(stream));
        stream.as_mut().set_write_timeout_pinned(Some(STALL_TIMEOUT));
        let (answer, busy) = (TowerToHyperService::new(routes.clone()), Arc::clone(&place.busy));
        let service = service_fn(move |request| {
            let (answer, busy) = (answer.call(request), Arc::clone(&busy));
            busy.store(true, Ordering::Relaxed);
            async move {
                let answer = answer.await;
                busy.store(false, Ordering::Relaxed);
                answer
            }
        });
        let connection = http.serve_connection(TokioIo::new(stream), service);
        let mut stopping = stopping.clone();
        tokio::spawn(async move {
            let mut connection = pin!(connection);
            let stop = async { drop(stopping.wait_for(|&stopping| stopping).await) };
            // Errors of the connection mean that the client has left.
            tokio::select! {
                _ = timeout(CONNECTION_TIMEOUT, connection.as_mut()) => return drop(place),
                _ = replaced => return drop(place),
                () = stop => connection.as_mut().graceful_shutdown(),
            }
            let _ = connection.await;
        });
    }
}

/// The open connections, the oldest first.
#[derive(Clone, Default)]
struct Connections(Arc<Mutex<Vec<Connection>>>);

struct Connection {
    address: IpAddr,
    /// Whether a request is being answered.
    busy: Arc<AtomicBool>,
    /// Dropped when another takes its place.
    _open: oneshot::Sender<()>,
}

/// An open connection, which counts until it is dropped.
struct Place {
    connections: Connections,
    busy: Arc<AtomicBool>,
}

impl Connections {
    fn lock(&self) -> MutexGuard<'_, Vec<Connection>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a connection, and what ends when another takes its place; `None` if all are busy.
    fn open(&self, address: IpAddr) -> Option<(Place, oneshot::Receiver<()>)> {
        let mut all = self.lock();
        let of_address = all.iter().filter(|one| one.address == address).count();
        if of_address >= MAX_OF_ADDRESS || all.len() >= MAX_OPEN {
            let may_go = |one: &Connection| {
                !one.busy.load(Ordering::Relaxed) && (of_address < MAX_OF_ADDRESS || one.address == address)
            };
            let idle = all.iter().position(may_go)?;
            all.remove(idle);
        }
        let (open, replaced) = oneshot::channel();
        let busy = Arc::new(AtomicBool::new(false));
        all.push(Connection { address, busy: Arc::clone(&busy), _open: open });
        Some((Place { connections: self.clone(), busy }, replaced))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.lock().retain(|one| !Arc::ptr_eq(&one.busy, &self.busy));
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use axum::body::Bytes;
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::{TcpSocket, TcpStream};

    use super::*;

    /// Sends this from an address of this machine; the client reads no more than a few bytes ahead.
    async fn sent(text: &str, from: [u8; 4], server: SocketAddr) -> io::Result<TcpStream> {
        let socket = TcpSocket::new_v4()?;
        socket.set_recv_buffer_size(4096)?;
        socket.bind(SocketAddr::from((from, 0)))?;
        let mut stream = socket.connect(server).await?;
        stream.write_all(text.as_bytes()).await?;
        Ok(stream)
    }

    const REQUEST: &str = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";

    /// Whether the server answers within two seconds.
    async fn is_answered(from: [u8; 4], server: SocketAddr) -> bool {
        let answer = async { sent(REQUEST, from, server).await?.read_exact(&mut [0; 12]).await };
        timeout(Duration::from_secs(2), answer).await.is_ok_and(|answer| answer.is_ok())
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn idle_connections_and_clients_that_do_not_read_leave_room_for_others() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let server = listener.local_addr().unwrap();
            let body = Bytes::from(vec![0; 4 << 20]);
            let routes = Router::new().route("/", get(move || async move { body.clone() }));
            let (stop, stopping) = watch::channel(false);
            let serving = tokio::spawn(serve(listener, routes, stopping));
            let (own, other) = ([127, 0, 0, 1], [127, 0, 0, 2]);
            let mut idle = Vec::new();
            for begun in ["", "GET / HT", REQUEST] {
                for _ in 0..MAX_OF_ADDRESS {
                    idle.push(sent(begun, own, server).await.unwrap());
                }
                let started = Instant::now();
                assert!(is_answered(own, server).await && is_answered(other, server).await, "{begun:?}");
                assert!(started.elapsed() < Duration::from_secs(2));
            }
            drop(idle);
            stop.send_replace(true);
            serving.await.unwrap().unwrap();
        });
    }

    #[test]
    fn a_busy_connection_keeps_its_place() {
        let connections = Connections::default();
        let [one, other] = [1, 2].map(|last| IpAddr::from([127, 0, 0, last]));
        let mut places: Vec<_> = (0..MAX_OF_ADDRESS).map(|_| connections.open(one).unwrap()).collect();
        places.iter().for_each(|(place, _)| place.busy.store(true, Ordering::Relaxed));
        assert!(connections.open(one).is_none() && connections.open(other).is_some());
        places[7].0.busy.store(false, Ordering::Relaxed);
        let newest = connections.open(one).unwrap();
        let replaced: Vec<bool> = places
            .iter_mut()
            .map(|(_, replaced)| replaced.try_recv().is_err_and(|e| e == oneshot::error::TryRecvError::Closed))
            .collect();
        assert_eq!(replaced.iter().position(|&replaced| replaced), Some(7));
        drop((places, newest));
        assert!(connections.lock().is_empty());
    }
}
