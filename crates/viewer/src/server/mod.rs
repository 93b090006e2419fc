//! The HTTP server: a WebSocket for each client, and files on request.

mod address_shares;
mod app;
mod guard;
mod http;
mod http_server;
mod message;
mod message_rate;
mod page;
mod routes;
mod socket;
mod stall_guard;

pub(crate) use app::App;
pub(crate) use guard::Guard;
pub(crate) use http_server::{Server, listen, reachable};
