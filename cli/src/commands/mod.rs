//! One module per subcommand.

pub(crate) mod batch;
pub(crate) mod depth;
pub(crate) mod inspect;
pub(crate) mod join;
pub(crate) mod manual;
pub(crate) mod models;
pub(crate) mod render;
pub(crate) mod select;
