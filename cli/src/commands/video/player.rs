//! The last stages of the pipeline: rendering, between the threads that read and the one that writes; and that one, which inpaints,
//! scales and writes frames to a folder, a file through ffmpeg, or standard output.

use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use liveview::geometry::Size;
use liveview::render::Frame;
use liveview::{Camera, ImageRgb};
use liveview_scene::save_picture;

use super::Viewpoint;
use super::gather::{Clock, Faults, Gathering, Step};
use super::governor::{Governor, Level};
use super::report::{Latencies, Scorer, Tally, VideoResults};
use crate::console::print_note;
use indicatif::ProgressBar;
use liveview_live::ffmpeg::{Encoder, FrameRate, is_address, is_video};
use liveview_live::interrupt::{self, Interrupted};
use liveview_live::rig::Feed;
use liveview_live::session::{LayerSource, LiveError, LiveSession};

/// Frames queued between the renderer and the writer.
const QUEUED_FRAMES: usize = 2;
/// The first frame of which more than this share is searched shows something else than the last: a cut.
const CUT_SHARE: f64 = 0.5;

/// Renders time steps and passes the frames to the writer.
pub(super) struct Player<'a> {
    pub(super) session: LiveSession,
    /// Whether a frame of the governor's current level was rendered.
    pub(super) settled: bool,
    /// Whether most of the last frame was searched.
    pub(super) was_searched: bool,
    pub(super) viewpoint: &'a Viewpoint,
    pub(super) truth: Option<usize>,
    pub(super) live: Option<(Governor, Clock)>,
    pub(super) scorer: Scorer,
    pub(super) tally: Tally,
    pub(super) changes: Vec<(usize, Level)>,
    pub(super) bar: &'a ProgressBar,
}

impl Player<'_> {
    /// Renders the whole video; its results, and the file or folder written.
    pub(super) fn play(mut self, gathering: &Arc<Gathering>, sink: Sink) -> Result<(VideoResults, Option<PathBuf>)> {
        let started = Instant::now();
        let target = self.viewpoint.camera(0);
        let size = target.size();
        let first = gathering.steps.start;
        let stop = Arc::clone(&gathering.stop);
        let (rendered, written) = std::thread::scope(|scope| {
            let steps = gathering.start(scope);
            let (shown, frames) = sync_channel(QUEUED_FRAMES);
            let stop = &stop;
            let writer = scope.spawn(move || write(sink, &frames, size, stop));
            let rendered = self.render_all(first, &steps, &shown);
            drop((steps, shown));
            (rendered, writer.join())
        });
        let stopped = stop.load(Ordering::Relaxed);
        // A failure of the writer goes first: rendering stopped because of it.
        let (written, sink) = written.map_err(|_| anyhow!("the thread that writes the video failed"))??;
        rendered?;
        let faults = std::mem::take(&mut *gathering.lock_faults());
        if !self.tally.covered {
            if stopped {
                return Err(Interrupted.into());
            }
            bail!("{}: {}", gathering.scene.root.display(), self.why_empty(first, &faults, &gathering.feeds));
        }
        let file = sink.finish()?;
        self.tally.finish()?;
        let Self { tally, changes, .. } = self;
        let all = gathering.steps.len();
        let interrupted = stopped && interrupt::requested() && tally.rendered + tally.repeated < all;
        let wall = started.elapsed();
        Ok((VideoResults { tally, written, faults, changes, wall, stopped, interrupted }, file))
    }

    /// The reason why the video from step `first` on shows nothing.
    fn why_empty(&mut self, first: usize, faults: &Faults, feeds: &[Feed]) -> String {
        if self.tally.rendered > 0 {
            return "no camera sees any part of the video; expected a viewpoint that looks where the cameras look"
                .to_owned();
        }
        let reasons = [faults.reasons(feeds), self.tally.why_repeated.take().unwrap_or_default()];
        let reasons: Vec<String> = reasons.into_iter().filter(|reasons| !reasons.is_empty()).collect();
        let ended = || format!("no camera has a frame from time step {first} on");
        format!("no frame could be rendered: {}", if reasons.is_empty() { ended() } else { reasons.join("; ") })
    }

    fn render_all(&mut self, first: usize, steps: &Receiver<Step>, shown: &SyncSender<WriterInput>) -> Result<()> {
        let mut next = first;
        for step in steps {
            let stale = self.live.as_ref().is_some_and(|(_, clock)| clock.is_stale(step.index));
            // The previous frame is repeated in place of those that are dropped.
            let dropped = step.index - next + usize::from(stale);
            for index in next..next + dropped {
                self.tally.dropped += 1;
                self.tally.repeat(index, "dropped: too late")?;
                if shown.send(WriterInput::Repeat).is_err() {
                    return Ok(());
                }
            }
            next = step.index + 1;
            self.bar.set_position((next - first) as u64);
            if !stale && !self.render(step, shown)? {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Renders a step, or repeats the previous frame; false if the writer has stopped or the network was interrupted.
    fn render(&mut self, mut step: Step, shown: &SyncSender<WriterInput>) -> Result<bool> {
        let truth = self.truth.and_then(|truth| step.photos[truth].take()).map(|(truth, _)| truth);
        let level = self.live.as_ref().map(|(governor, _)| governor.level());
        let target = scaled(self.viewpoint.camera(step.index), level.map_or(1.0, |level| level.scale))?;
        let photos: Vec<_> = step.photos.iter().map(|photo| photo.as_ref().map(|(photo, _)| photo)).collect();
        let frame = match self.session.render(&photos, &target) {
            Ok(frame) => frame,
            Err(error @ LiveError::Views(_)) => {
                self.scorer.restart();
                self.tally.repeat(step.index, &error.to_string())?;
                return Ok(shown.send(WriterInput::Repeat).is_ok());
            }
            Err(error) if interrupt::requested() => {
                self.bar.suspend(|| print_note(&format!("frame {} was given up: {error}", step.index)));
                return Ok(false);
            }
            Err(error) => return Err(error.into()),
        };
        let scores = match truth {
            Some(truth) => self.scorer.score(&frame.frame.picture(), truth),
            None => {
                self.scorer.restart();
                None
            }
        };
        self.tally.add(&step, &frame, scores)?;
        // The first frame of a level and that of a cut take longer: their times do not count.
        let is_searched = match frame.layer_source {
            LayerSource::Propagated { refreshed } => refreshed > CUT_SHARE,
            source => source == LayerSource::Searched,
        };
        let is_cut = is_searched && !std::mem::replace(&mut self.was_searched, is_searched);
        let settled = std::mem::replace(&mut self.settled, true) && !is_cut;
        let live = self.live.as_mut().filter(|_| settled);
        if let Some(level) = live.and_then(|(governor, _)| governor.record(frame.times.total())) {
            self.session.set_layers(level.layers.clone(), level.coarse_depth);
            self.settled = false;
            self.changes.push((step.index + 1, level.clone()));
        }
        let used = frame.views.iter().filter(|_| self.live.is_some()).filter_map(|&view| step.photos[view].as_ref());
        let arrived = used.map(|&(_, arrived)| arrived).collect();
        Ok(shown.send(WriterInput::Frame { arrived, frame: Box::new(frame.frame) }).is_ok())
    }
}

/// The target camera with both sides of the picture scaled.
fn scaled(target: &Camera, scale: f64) -> Result<Camera> {
    let side = |side: usize| ((side as f64 * scale).round() as usize).max(1);
    Ok(target.with_size_scaled(side(target.width()), side(target.height()))?)
}

/// Prefix of the names of frames in a folder.
pub(super) const FRAME_PREFIX: &str = "frame_";

/// The file of a frame in a folder.
pub(super) fn frame_file(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("{FRAME_PREFIX}{index:06}.png"))
}

/// A video being written, frame by frame.
#[derive(Debug)]
pub(super) enum Sink {
    /// A folder of frames.
    Folder {
        /// The folder.
        path: PathBuf,
        /// Number of frames written.
        frames: usize,
    },
    /// A file or an address, through ffmpeg.
    Video(Encoder),
    /// Raw y4m on standard output.
    Y4m {
        /// Standard output.
        pipe: BufWriter<std::io::Stdout>,
        /// Frames per second.
        rate: FrameRate,
        /// Number of frames written.
        frames: usize,
    },
}

impl Sink {
    /// The sink for a path: `-` is raw y4m on standard output, .mp4, .gif and addresses are written by ffmpeg, all else is a folder.
    pub(super) fn new(path: &Path, rate: FrameRate) -> Result<Self> {
        if path == Path::new("-") {
            return Ok(Self::Y4m { pipe: BufWriter::new(std::io::stdout()), rate, frames: 0 });
        }
        if is_address(path) || is_video(path) {
            return Ok(Self::Video(Encoder::new(path, rate, print_note)?));
        }
        if path.is_file() || path.extension().is_some() && !path.is_dir() {
            bail!(
                "-o {}: expected a name that ends in .mp4 or .gif, an address, a folder for the frames, or - for y4m on standard output",
                path.display()
            );
        }
        Ok(Self::Folder { path: path.to_owned(), frames: 0 })
    }

    /// Writes a frame; false if the reader of standard output has closed it.
    pub(super) fn add(&mut self, picture: &ImageRgb) -> Result<bool> {
        match self {
            Self::Folder { path, frames } => {
                save_picture(picture, &frame_file(path, *frames))?;
                *frames += 1;
            }
            Self::Video(video) => video.add(picture)?,
            Self::Y4m { pipe, rate, frames } => {
                let mut bytes = Vec::new();
                if *frames == 0 {
                    let (width, height) = (picture.width(), picture.height());
                    bytes = format!(
                        "YUV4MPEG2 W{width} H{height} F{}:{} Ip A1:1 C444 XCOLORRANGE=LIMITED\n",
                        rate.frames, rate.seconds
                    )
                    .into_bytes();
                }
                *frames += 1;
                y4m_frame(picture, &mut bytes);
                return match pipe.write_all(&bytes).and_then(|()| pipe.flush()) {
                    Ok(()) => Ok(true),
                    Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
                    Err(error) => Err(error).context("-o -: standard output: cannot be written"),
                };
            }
        }
        Ok(true)
    }

    /// Finishes the output; the file or folder written, `None` for standard output.
    pub(super) fn finish(self) -> Result<Option<PathBuf>> {
        match self {
            Self::Folder { path, .. } => Ok(Some(path)),
            Self::Video(video) => video.finish().map(Some),
            Self::Y4m { .. } => Ok(None),
        }
    }
}

/// A frame of a y4m stream: BT.601 at limited range, as players assume, with a chroma sample for each pixel (4:4:4).
fn y4m_frame(picture: &ImageRgb, out: &mut Vec<u8>) {
    const YCBCR_FROM_RGB: [[f32; 4]; 3] =
        [[16.0, 65.481, 128.553, 24.966], [128.0, -37.797, -74.203, 112.0], [128.0, 112.0, -93.786, -18.214]];
    out.extend_from_slice(b"FRAME\n");
    for [offset, red, green, blue] in YCBCR_FROM_RGB {
        let value = |rgb: &[f32]| {
            let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(|value| value.clamp(0.0, 1.0));
            // Above 16 the sum is exact enough to round like `round`.
            (offset + red * r + green * g + blue * b + 0.5) as u8
        };
        out.extend(picture.data().chunks_exact(3).map(value));
    }
}

/// Totals of the frames written.
pub(super) struct Written {
    pub(super) latencies: Latencies,
    pub(super) encoding: Duration,
    pub(super) frames: usize,
}

/// A frame for the writer.
pub(super) enum WriterInput {
    /// A rendered frame, to be inpainted and scaled, and when each of its photos arrived, if it is live.
    Frame { arrived: Vec<Instant>, frame: Box<Frame> },
    /// The last frame again.
    Repeat,
}

/// Inpaints, scales and writes frames until there are no more.
pub(super) fn write(
    mut sink: Sink,
    frames: &Receiver<WriterInput>,
    size: Size,
    stop: &AtomicBool,
) -> Result<(Written, Sink)> {
    let mut written = Written { latencies: Latencies::new(), encoding: Duration::ZERO, frames: 0 };
    // Black until the first frame. Except in a stream, which a player may show, it is not written before: there may be no frame
    // at all.
    let mut last = ImageRgb::new(size.width, size.height, vec![0.0; 3 * size.pixels()])?;
    let (black, mut held_back) = (last.clone(), Some(0));
    for input in frames {
        let started = Instant::now();
        let mut since = Vec::new();
        if let WriterInput::Frame { arrived, frame } = input {
            since = arrived;
            last = frame.picture();
            if last.size() != size {
                last = last.resized(size.width, size.height)?;
            }
        } else if let Some(frames) = held_back.as_mut().filter(|_| !matches!(sink, Sink::Y4m { .. })) {
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
        since.iter().for_each(|arrived| written.latencies.add(arrived.elapsed()));
        if !wanted {
            stop.store(true, Ordering::Relaxed);
            break;
        }
    }
    Ok((written, sink))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_converted_by_bt_601() {
        let picture = ImageRgb::new(3, 1, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]).unwrap();
        let mut bytes = Vec::new();
        y4m_frame(&picture, &mut bytes);
        assert_eq!(bytes, [&b"FRAME\n"[..], &[16, 235, 81, 128, 128, 90, 128, 128, 240]].concat());
    }
}
