//! One module per subcommand.

#[cfg(feature = "viewer")]
pub(crate) mod bake;
pub(crate) mod depth;
pub(crate) mod inspect;
pub(crate) mod poses;
pub(crate) mod render;
pub(crate) mod sweep;
pub(crate) mod video;
#[cfg(feature = "viewer")]
pub(crate) mod view;
