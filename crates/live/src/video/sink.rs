//! The output of a video: a folder of frames, a file through ffmpeg, or standard output; and the last stage of the pipeline,
//! which inpaints, scales and writes frames.

use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use liveview::ImageRgb;
use liveview::geometry::Size;
use liveview::render::Frame;

use super::gather::Clock;
use super::report::Latencies;
use crate::ffmpeg::{Encoder, FrameRate, is_video};

/// Prefix of the names of frames in a folder.
pub const FRAME_PREFIX: &str = "frame_";

/// The file of a frame in a folder.
pub fn frame_file(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("{FRAME_PREFIX}{index:06}.png"))
}

/// A video being written, frame by frame.
#[derive(Debug)]
pub enum Sink {
    /// A folder of frames.
    Folder {
        /// The folder.
        path: PathBuf,
        /// Number of frames written.
        frames: usize,
    },
    /// A file, through ffmpeg.
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
    /// The sink for a path: `-` is raw y4m on standard output, .mp4 and .gif are encoded by ffmpeg, all else is a folder.
    pub fn new(path: &Path, rate: FrameRate, note: fn(&str)) -> Result<Self> {
        if path == Path::new("-") {
            return Ok(Self::Y4m { pipe: BufWriter::new(std::io::stdout()), rate, frames: 0 });
        }
        if is_video(path) {
            return Ok(Self::Video(Encoder::new(path, rate, note)?));
        }
        if path.is_file() || path.extension().is_some() && !path.is_dir() {
            bail!(
                "-o {}: expected a name that ends in .mp4 or .gif, a folder for the frames, or - for y4m on standard output",
                path.display()
            );
        }
        Ok(Self::Folder { path: path.to_owned(), frames: 0 })
    }

    /// Whether a player may show frames as they are written.
    pub(super) fn is_stream(&self) -> bool {
        matches!(self, Self::Y4m { .. })
    }

    /// Writes a frame; false if the reader of standard output has closed it.
    pub(super) fn add(&mut self, picture: &ImageRgb) -> Result<bool> {
        match self {
            Self::Folder { path, frames } => {
                picture.save(frame_file(path, *frames))?;
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
            (offset + red * r + green * g + blue * b).round() as u8
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
            last = frame.picture();
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
