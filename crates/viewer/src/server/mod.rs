//! The HTTP server: a WebSocket for each client, and files on request.

mod app;
mod guard;
mod http_server;
mod limits;
mod message;
mod routes;
mod socket;

pub(crate) use app::App;
pub(crate) use guard::Guard;
pub(crate) use http_server::{Server, listen, reachable};
