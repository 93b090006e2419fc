//! A running viewer, and its clients.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Message, WebSocket};

use super::{Folders, fixture};

/// A timeout longer than any step takes: a test fails instead of hanging.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// A running viewer of the tiny scene.
pub(crate) struct Viewer {
    child: Child,
    pub(crate) host: String,
    pub(crate) query: String,
    /// Further lines of standard error.
    pub(crate) lines: Box<dyn Iterator<Item = String> + Send>,
}

impl Viewer {
    pub(crate) fn start(folders: &Folders, arguments: &[&str]) -> Self {
        Self::start_with(folders, arguments, |_| ())
    }

    /// `prepare` may change the command, such as its environment.
    pub(crate) fn start_with(folders: &Folders, arguments: &[&str], prepare: impl FnOnce(&mut Command)) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_liveview"));
        prepare(&mut command);
        command.arg("view").arg(folders.scene()).args(["--port", "0", "--model", &fixture("tiny_v4")]).args(arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        let link =
            lines.by_ref().inspect(|line| eprintln!("{line}")).find(|line| line.starts_with("open: ")).expect("a link");
        let (host, query) = link["open: http://".len()..].split_once('/').unwrap();
        let query = query.split_whitespace().next().filter(|query| query.starts_with('?')).unwrap_or_default();
        let (host, query) = (host.to_owned(), query.to_owned());
        Self { child, host, query, lines: Box::new(lines) }
    }

    pub(crate) fn stream(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
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

    /// A client, or the status with which it was refused.
    pub(crate) fn open(&self, headers: &[(&'static str, &str)]) -> Result<Client, u16> {
        let mut request = format!("ws://{}/socket{}", self.host, self.query).into_client_request().unwrap();
        for (name, value) in headers {
            request.headers_mut().insert(*name, value.parse().unwrap());
        }
        match tungstenite::client(request, self.stream()) {
            Ok((socket, _)) => Ok(Client { socket }),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// A client, and the session info that it received.
    pub(crate) fn client(&self) -> (Client, Value) {
        let mut client = self.open(&[("Origin", &format!("http://{}", self.host))]).unwrap();
        let info = client.text();
        (client, info)
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

pub(crate) struct Client {
    pub(crate) socket: WebSocket<TcpStream>,
}

impl Client {
    pub(crate) fn send(&mut self, message: &Value) {
        self.socket.send(Message::text(message.to_string())).unwrap();
    }

    pub(crate) fn request(&mut self, id: u64, camera: &Value, moving: bool) {
        self.send(&json!({ "id": id, "camera": camera, "moving": moving, "depth": false }));
    }

    /// The next message that is not a ping.
    pub(crate) fn next(&mut self) -> Message {
        loop {
            match self.socket.read().unwrap() {
                Message::Ping(_) | Message::Pong(_) => {}
                message => return message,
            }
        }
    }

    pub(crate) fn text(&mut self) -> Value {
        serde_json::from_str(self.next().to_text().unwrap()).unwrap()
    }

    /// Header and picture of the next frame.
    pub(crate) fn frame(&mut self) -> (Value, Vec<u8>) {
        parts(self.next())
    }

    /// Header and picture at full quality; before it come drafts, and how far the search for depth is. All are acknowledged.
    pub(crate) fn rested(&mut self) -> (Value, Vec<u8>) {
        loop {
            let message = self.next();
            if let Message::Text(text) = &message {
                let search = &serde_json::from_str::<Value>(text).unwrap()["search"];
                assert!(search["done"].as_u64().unwrap() < search["count"].as_u64().unwrap(), "{text}");
                continue;
            }
            let (header, picture) = parts(message);
            self.send(&json!({ "shown": header["id"] }));
            if header["search"].is_null() {
                return (header, picture);
            }
            assert_eq!((&header["layers"], &picture[..2]), (&"guided:1".into(), &[0xFF, 0xD8][..]), "a draft");
        }
    }

    /// The code and the reason with which the connection is closed.
    pub(crate) fn closed(&mut self) -> (CloseCode, String) {
        match self.next() {
            Message::Close(Some(why)) => (why.code, why.reason.to_string()),
            other => panic!("{other:?}"),
        }
    }
}

/// Header and picture of a frame.
fn parts(frame: Message) -> (Value, Vec<u8>) {
    let data = frame.into_data();
    let (length, rest) = data.split_at(4);
    let (header, picture) = rest.split_at(u32::from_le_bytes(length.try_into().unwrap()) as usize);
    (serde_json::from_slice(header).unwrap(), picture.to_vec())
}

/// The camera of a view in the session info, moved to the right along its own x axis.
pub(crate) fn moved(info: &Value, view: usize, by: f64) -> Value {
    let mut camera = info["views"][view]["camera"].clone();
    let x = camera["cam_from_world"][0][3].as_f64().unwrap();
    camera["cam_from_world"][0][3] = (x - by).into();
    camera
}
