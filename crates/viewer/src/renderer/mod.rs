//! Renders requested views: in motion as large as the frame rate allows, at rest at full quality.

mod depth_searches;
mod frames;
mod photos;
mod source;
mod video;
mod view_renderer;

pub(crate) use photos::Photos;
pub(crate) use source::Source;
#[cfg(test)]
pub(crate) use source::fake::FakeSource;
pub(crate) use video::Video;
pub(crate) use view_renderer::ViewRenderer;
