//! Renders requested views: in motion as large as the frame rate allows, at rest at full quality.

mod depth_searches;
#[cfg(test)]
mod fake_source;
mod frames;
mod photos;
mod shared;
mod size_controller;
mod source;
mod video;
mod view_renderer;

#[cfg(test)]
pub(crate) use fake_source::FakeSource;
pub(crate) use photos::Photos;
pub(crate) use source::Source;
pub(crate) use video::Video;
pub(crate) use view_renderer::ViewRenderer;
