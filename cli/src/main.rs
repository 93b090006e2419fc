//! The `liveview` command; `liveview --help` says what it does.

mod cli;
mod report;
mod stability;

fn main() -> std::process::ExitCode {
    cli::run()
}
