//! The last stage of the pipeline: inpaints, scales and writes frames.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::ImageRgb;
use liveview::geometry::Size;
use liveview::render::Frame;

use super::gather::Clock;
use super::sink::Sink;
use super::tally::Latencies;

/// Totals of the frames written.
pub(super) struct Written {
    pub(super) latencies: Latencies,
    pub(super) encoding: Duration,
    pub(super) frames: usize,
}

/// A frame for the writer.
pub(super) enum WriterInput {
    /// A rendered frame, to be inpainted and scaled.
    Frame { step: usize, frame: Box<Frame> },
    /// The last frame again.
    Repeat,
}

/// Inpaints, scales and writes frames until there are no more.
pub(super) fn write(
    mut sink: Sink,
    frames: &Receiver<WriterInput>,
    size: Size,
    clock: Option<Clock>,
    stop: &AtomicBool,
) -> Result<(Written, Sink)> {
    let mut written = Written { latencies: Latencies::new(), encoding: Duration::ZERO, frames: 0 };
    // Black until the first frame. Except in a stream it is not written before: there may be no frame at all.
    let mut last = ImageRgb::new(size.width, size.height, vec![0.0; 3 * size.pixels()])?;
    let (black, mut held_back) = (last.clone(), Some(0));
    for input in frames {
        let started = Instant::now();
        let mut due = None;
        if let WriterInput::Frame { step, frame } = input {
            due = clock.map(|clock| clock.due(step));
            last = frame.inpainted();
            if last.size() != size {
                last = last.resized(size.width, size.height)?;
            }
        } else if let Some(frames) = held_back.as_mut().filter(|_| !sink.is_stream()) {
            *frames += 1;
            continue;
        }
        let mut add = |picture: &ImageRgb| {
            written.frames += 1;
            sink.add(picture).inspect_err(|_| stop.store(true, Ordering::Relaxed))
        };
        for _ in 0..held_back.take().unwrap_or(0) {
            add(&black)?;
        }
        let wanted = add(&last)?;
        written.encoding += started.elapsed();
        if let Some(due) = due {
            written.latencies.add(due.elapsed());
        }
        if !wanted {
            stop.store(true, Ordering::Relaxed);
            break;
        }
    }
    Ok((written, sink))
}
