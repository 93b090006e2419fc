//! A scene, or the video of a rig, in the browser; the mouse, a finger or keys move the viewpoint.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

mod opened;
mod renderer;
mod request;
mod request_queue;
mod server;
mod settings;
mod waiting;

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use opened::Opened;
use renderer::ViewRenderer;
use request::{FileError, FileRequest, Message, Task};
use request_queue::RequestQueue;
use serde_json::json;
use server::{App, Guard, Server, listen, reachable};
pub use settings::{RigVideo, Shown, ViewSettings};
use waiting::Waiting;

/// Interval at which an interrupt is looked for.
const INTERRUPT_POLL: Duration = Duration::from_millis(100);

/// A server that listens, and does not answer yet.
#[derive(Debug)]
pub struct Viewer {
    guard: Guard,
    listener: TcpListener,
    address: SocketAddr,
}

/// What was served.
#[derive(Debug)]
pub struct Served {
    /// The link to the page.
    pub link: String,
    /// Number of pictures rendered.
    pub pictures: u64,
    /// Number of viewers.
    pub viewers: u64,
}

impl Viewer {
    /// Listens at a port: of this machine alone, or of the address `bind`, by which others have access.
    pub fn listen(bind: Option<IpAddr>, port: u16) -> Result<Self> {
        let guard = Guard::new(bind)?;
        let (listener, address) = listen(bind, port)?;
        Ok(Self { guard, listener, address })
    }

    /// Serves a scene or a rig until the flag that `watch` returns is set. `ready` gets the link to the page.
    pub fn serve(
        self,
        shown: Shown,
        settings: ViewSettings,
        watch: impl FnOnce() -> Result<Arc<AtomicBool>>,
        ready: impl FnOnce(&str),
    ) -> Result<Served> {
        let Self { guard, listener, address } = self;
        let queue = Arc::new(RequestQueue::default());
        let opened = opened::open(shown, &settings, &queue)?;
        let info = opened::session_info(&opened, &settings).to_string();
        let Opened { source, start_view, video, .. } = opened;
        let scene = source.scene().clone();
        let mut renderer = ViewRenderer::new(source, settings.held_out, scene.views[start_view].camera.clone());
        let (interrupted, stopped_queue) = (watch()?, Arc::clone(&queue));
        std::thread::spawn(move || {
            while !interrupted.load(Ordering::Relaxed) {
                sleep(INTERRUPT_POLL);
            }
            stopped_queue.stop();
        });
        let link = format!("http://{}/{}", reachable(address), guard.query());
        let app = App::new(Arc::clone(&queue), scene, video.map(|video| video.steps), info, guard);
        let server = Server::start(listener, app)?;
        ready(&link);
        serve(&queue, &mut renderer, settings.error_text);
        let viewers = queue.joined();
        server.stop()?;
        Ok(Served { link, pictures: renderer.pictures(), viewers })
    }
}

/// Serves requests until the queue is stopped.
fn serve(queue: &RequestQueue, renderer: &mut ViewRenderer, error_text: fn(&anyhow::Error) -> String) {
    // Before the first client, as many photos are prepared as a first picture takes.
    let mut first = renderer.source.needed_first();
    let mut waiting = Waiting::default();
    loop {
        waiting.start_search(queue, renderer);
        let prepare = renderer.source.unprepared() > 0 && (first > 0 || queue.has_clients());
        match queue.next(prepare) {
            Task::Stop => return,
            Task::Frame { client, request } => {
                let message = match renderer.frame(&request) {
                    Ok(frame) => Message::Frame(frame.into()),
                    Err(error) => Message::Text(json!({ "error": error_text(&error), "id": request.id }).to_string()),
                };
                queue.send(client, message);
                let waits = renderer.awaited(&request.viewpoint, request.moving).is_some();
                waiting.set_view(client, Some(request).filter(|_| waits));
            }
            Task::File { request: FileRequest::Picture(viewpoint), reply }
                if renderer.awaited(&viewpoint, false).is_some() =>
            {
                waiting.add_file(viewpoint, reply);
            }
            Task::Found { view, found } => {
                renderer.source.insert(view, found);
                waiting.update(queue, renderer);
            }
            // Sending fails if the client has left.
            Task::File { request, reply } => {
                drop(reply.send(renderer.file(&request).map_err(|error| FileError::Failed(error_text(&error)))));
            }
            Task::Prepare => {
                first = first.saturating_sub(1);
                // An unreadable photo is reported with the first picture that needs it.
                let _ = renderer.prepare();
            }
        }
    }
}
