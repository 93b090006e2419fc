//! Texts of the help that all commands share.

/// Help heading of the options that few people need; `-h` does not list them.
pub(crate) const ADVANCED: &str = "Advanced";
