//! The HTTP server, in its own thread.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, UdpSocket};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use tokio::time::sleep;

use super::app::App;
use super::http;
use super::routes::routes;

/// Time for open connections to end.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// A listening socket and its address: that of this machine alone unless one is given.
pub(crate) fn listen(bind: Option<IpAddr>, port: u16) -> Result<(TcpListener, SocketAddr)> {
    let address = SocketAddr::new(bind.unwrap_or(Ipv4Addr::LOCALHOST.into()), port);
    let listener = TcpListener::bind(address);
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
    pub(crate) fn start(listener: TcpListener, app: App) -> Result<Self> {
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

async fn run(listener: TcpListener, app: Arc<App>) -> io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    http::serve(listener, routes(&app), app.stopping.subscribe()).await?;
    tokio::select! {
        () = app.stopping.closed() => {}
        () = sleep(CLOSE_TIMEOUT) => {}
    }
    Ok(())
}
