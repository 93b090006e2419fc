//! A running viewer.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use super::{Folders, fixture};

/// A timeout longer than any step takes: a test fails instead of hanging.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// A running viewer of the tiny scene.
pub(crate) struct Viewer {
    child: Child,
    pub(crate) host: String,
    pub(crate) query: String,
    /// Further lines of standard error.
    pub(crate) lines: Box<dyn Iterator<Item = String> + Send + Sync>,
}

impl Viewer {
    pub(crate) fn start(folders: &Folders, arguments: &[&str]) -> Self {
        Self::start_with(folders, arguments, |_| ())
    }

    /// `prepare` may change the command, such as its environment.
    pub(crate) fn start_with(folders: &Folders, arguments: &[&str], prepare: impl FnOnce(&mut Command)) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_liveview"));
        prepare(&mut command);
        // A free port: the link may name a front.
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port().to_string();
        command
            .arg("view")
            .arg(folders.scene())
            .args(["--port", &port, "--model", &fixture("tiny_v4")])
            .args(arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        let link =
            lines.by_ref().inspect(|line| eprintln!("{line}")).find(|line| line.starts_with("open: ")).expect("a link");
        let (scheme, rest) = link["open: ".len()..].split_once("://").unwrap();
        let (host, query) = rest.split_once('/').unwrap();
        let query = query.split_whitespace().next().filter(|query| query.starts_with('?')).unwrap_or_default();
        let host = if scheme == "http" { host.to_owned() } else { format!("127.0.0.1:{port}") };
        let query = query.to_owned();
        Self { child, host, query, lines: Box::new(lines) }
    }

    pub(crate) fn stream(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Status and whole answer, as text.
    pub(crate) fn ask_whole(&self, first: &str) -> (u16, String) {
        let mut stream = self.stream();
        let head = format!("{first} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.host);
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let text = String::from_utf8_lossy(&answer).into_owned();
        (text[9..12].parse().unwrap(), text)
    }

    /// Status and body of a request with these headers; `Host` is the viewer's unless they name
    /// one.
    pub(crate) fn ask(&self, first: &str, headers: &[(&str, &str)], body: &str) -> (u16, Vec<u8>) {
        let host = ("Host", self.host.as_str());
        let named = headers.iter().any(|(name, _)| *name == "Host");
        let headers =
            headers.iter().chain((!named).then_some(&host)).map(|(name, value)| format!("{name}: {value}\r\n"));
        let head = format!("{first} HTTP/1.1\r\n{}Content-Length: {}\r\n", headers.collect::<String>(), body.len());
        let mut stream = self.stream();
        stream.write_all(format!("{head}Connection: close\r\n\r\n{body}").as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap();
        let status = std::str::from_utf8(&answer[9..12]).unwrap().parse().unwrap();
        (status, answer.split_off(end + 4))
    }

    pub(crate) fn status(&self, first: &str, headers: &[(&str, &str)]) -> u16 {
        self.ask(first, headers, "").0
    }

    /// The scene's description in the page.
    pub(crate) fn description(&self) -> Value {
        let (status, page) = self.ask(&format!("GET /{}", self.query), &[], "");
        assert_eq!(status, 200);
        described(&String::from_utf8(page).unwrap())
    }

    /// The answer to a request for the picture of a camera.
    pub(crate) fn picture(&self, body: &Value) -> (u16, Vec<u8>) {
        self.ask(&format!("POST /picture{}", self.query), &[], &body.to_string())
    }

    /// Ctrl-C: the exit code and what was printed.
    pub(crate) fn end(mut self) -> (Option<i32>, String) {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
        let mut printed = String::new();
        self.child.stdout.take().unwrap().read_to_string(&mut printed).unwrap();
        (self.child.wait().unwrap().code(), printed)
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The scene's description in a page.
pub(crate) fn described(page: &str) -> Value {
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"scene\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// The camera of a view in the page's description, moved to the right along its own x axis.
pub(crate) fn moved(info: &Value, view: usize, by: f64) -> Value {
    let mut camera = info["views"][view]["camera"].clone();
    let x = camera["cam_from_world"][0][3].as_f64().unwrap();
    camera["cam_from_world"][0][3] = (x - by).into();
    camera
}
