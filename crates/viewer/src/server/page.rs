//! The files of the page, which are part of the program.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Content security policy: the page loads nothing from elsewhere, and no other page may embed it.
pub(crate) const SECURITY_POLICY: &str =
    "default-src 'self'; img-src 'self' blob: data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'";

const FILES: [(&str, &str, &str); 9] = [
    ("index.html", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("view.css", "text/css; charset=utf-8", include_str!("page/view.css")),
    ("view.js", SCRIPT, include_str!("page/view.js")),
    ("rig.js", SCRIPT, include_str!("page/rig.js")),
    ("input.js", SCRIPT, include_str!("page/input.js")),
    ("link.js", SCRIPT, include_str!("page/link.js")),
    ("panel.js", SCRIPT, include_str!("page/panel.js")),
    ("player.js", SCRIPT, include_str!("page/player.js")),
    ("recorder.js", SCRIPT, include_str!("page/recorder.js")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// A file of the page.
pub(crate) fn file(name: &str) -> Response {
    match FILES.iter().find(|(known, ..)| *known == name) {
        Some(&(_, kind, text)) => {
            ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-cache")], text).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}
