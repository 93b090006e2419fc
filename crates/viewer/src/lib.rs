//! `liveview view`: a scene, or the video of a rig, in the browser; the mouse, a finger or keys move the viewpoint.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

mod opened;
mod options;
mod renderer;
mod request;
mod request_queue;
mod server;
mod session_info;
mod waiting;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use liveview_common::console::{Output, full_text, print_message};
use liveview_common::interrupt;
use opened::Opened;
pub use options::ViewArgs;
use renderer::ViewRenderer;
use request::{FileError, FileRequest, Message, Task};
use request_queue::RequestQueue;
use serde_json::json;
use server::{App, Guard, Server, listen, reachable};
use session_info::SessionInfo;
use waiting::Waiting;

/// Interval at which an interrupt is looked for.
const INTERRUPT_POLL: Duration = Duration::from_millis(100);

/// Runs `liveview view`.
pub fn run(args: &ViewArgs) -> Result<Output> {
    let guard = Guard::new(args.bind)?;
    let (listener, address) = listen(args.bind, args.port)?;
    let queue = Arc::new(RequestQueue::default());
    let Opened { source, engine, runs, held_out, start_view, near, video } = opened::open(args, &queue)?;
    let scene = source.scene().clone();
    let info = SessionInfo { scene: &scene, engine: &engine, held_out: &held_out, start_view, near, video };
    let info = info.to_json().to_string();
    let mut renderer = ViewRenderer::new(source, held_out, scene.views[start_view].camera.clone());
    let (interrupted, stopped_queue) = (interrupt::watch(runs)?, Arc::clone(&queue));
    std::thread::spawn(move || {
        while !interrupted.load(Ordering::Relaxed) {
            sleep(INTERRUPT_POLL);
        }
        stopped_queue.stop();
    });
    let link = format!("http://{}/{}", reachable(address), guard.query());
    let app = App::new(Arc::clone(&queue), scene, video.map(|video| video.steps), info, guard);
    let server = Server::start(listener, app)?;
    print_message("open", format_args!("{link} (Ctrl-C ends it)"));
    if args.open
        && let Err(error) = open::that_detached(&link)
    {
        print_message("note", format_args!("--open: no browser could be started ({error}); open the link yourself"));
    }
    serve(&queue, &mut renderer);
    let viewers = queue.joined();
    server.stop()?;
    let pictures = renderer.pictures();
    let text = format!("{pictures} pictures for {viewers} {}\n", if viewers == 1 { "viewer" } else { "viewers" });
    Ok(Output { text, json: json!({ "link": link, "pictures": pictures, "viewers": viewers }) })
}

/// Serves requests until the queue is stopped.
fn serve(queue: &RequestQueue, renderer: &mut ViewRenderer) {
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
                    Err(error) => Message::Text(json!({ "error": full_text(&error), "id": request.id }).to_string()),
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
                drop(reply.send(renderer.file(&request).map_err(|error| FileError::Failed(full_text(&error)))));
            }
            Task::Prepare => {
                first = first.saturating_sub(1);
                // An unreadable photo is reported with the first picture that needs it.
                let _ = renderer.prepare();
            }
        }
    }
}
