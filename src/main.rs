//! The `liveview` command; `liveview --help` says what it does.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
