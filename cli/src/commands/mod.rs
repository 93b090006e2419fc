//! One module per subcommand.

pub(crate) mod depth;
pub(crate) mod inspect;
pub(crate) mod render;
