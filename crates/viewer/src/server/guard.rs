//! Access control: only the server's own page may send requests, and with `--bind` only with the token of the link.

use std::net::IpAddr;

use anyhow::Result;
use axum::http::header::{HOST, HeaderName, ORIGIN};
use axum::http::{HeaderMap, Uri};

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const TOKEN_BYTES: usize = 16;

/// The conditions that a request must meet.
#[derive(Debug)]
pub(crate) struct Guard {
    /// Part of the link if the server is bound to an address of the user's choice.
    token: Option<String>,
}

impl Guard {
    /// `bind`: the address given; without one only requests to a local host name are accepted.
    pub(crate) fn new(bind: Option<IpAddr>) -> Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| anyhow::anyhow!("no random numbers for a token: {error}"))?;
        Ok(Self { token: bind.map(|_| bytes.iter().map(|byte| format!("{byte:02x}")).collect()) })
    }

    /// The part of the link after the address.
    pub(crate) fn query(&self) -> String {
        self.token.as_ref().map(|token| format!("?token={token}")).unwrap_or_default()
    }

    /// Checks a request; an error is the reason for which it is refused.
    pub(crate) fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), &'static str> {
        let header = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
        let host = header(HOST).unwrap_or_default();
        // DNS rebinding, by which another site sends requests here, shows in Host. With a token any host name is accepted.
        if self.token.is_none() && !is_local(host) {
            return Err("Host: expected 127.0.0.1 or localhost");
        }
        if header(ORIGIN).is_some_and(|origin| !origin.eq_ignore_ascii_case(&format!("http://{host}"))) {
            return Err("Origin: another page may not use this server");
        }
        if header(FETCH_SITE).is_some_and(|site| site != "same-origin" && site != "none") {
            return Err("Sec-Fetch-Site: another page may not use this server");
        }
        match &self.token {
            Some(token) if !has_token(uri, token) => {
                Err("expected the link that `liveview view` printed, with its token")
            }
            _ => Ok(()),
        }
    }
}

/// Whether a Host header names this machine; the port may differ behind a tunnel.
fn is_local(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    ["127.0.0.1", "localhost", "[::1]"].iter().any(|local| local.eq_ignore_ascii_case(name))
}

/// Whether the query holds the token; compared in constant time.
fn has_token(uri: &Uri, token: &str) -> bool {
    let given = uri.query().unwrap_or_default().split('&').find_map(|pair| pair.strip_prefix("token="));
    let given = given.unwrap_or_default().as_bytes();
    let differing = given.iter().zip(token.as_bytes()).fold(0, |bits, (a, b)| bits | (a ^ b));
    given.len() == token.len() && differing == 0
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn is_accepted(guard: &Guard, uri: &str, given: &[(&'static str, &'static str)]) -> bool {
        let headers =
            given.iter().map(|&(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value)));
        guard.check(&uri.parse().unwrap(), &headers.collect()).is_ok()
    }

    #[test]
    fn without_bind_only_local_hosts_and_same_origin_are_accepted() {
        let guard = Guard::new(None).unwrap();
        assert_eq!(guard.query(), "");
        for host in ["127.0.0.1:8090", "localhost:8090", "LOCALHOST:8090", "localhost", "[::1]:8090"] {
            assert!(is_accepted(&guard, "/", &[("host", host)]), "{host}");
        }
        for host in ["", "evil.example", "127.0.0.1.evil.example:8090", "localhost:evil", "192.168.1.2:8090"] {
            assert!(!is_accepted(&guard, "/", &[("host", host)]), "{host}");
        }
        let host = ("host", "localhost:8090");
        for (name, value, expected) in [
            ("origin", "http://localhost:8090", true),
            ("origin", "http://localhost:9000", false),
            ("origin", "https://localhost:8090", false),
            ("origin", "null", false),
            ("sec-fetch-site", "none", true),
            ("sec-fetch-site", "cross-site", false),
            ("sec-fetch-site", "same-site", false),
        ] {
            assert_eq!(is_accepted(&guard, "/socket", &[host, (name, value)]), expected, "{name}: {value}");
        }
    }

    #[test]
    fn with_bind_the_token_is_required() {
        let guard = Guard::new(Some([0, 0, 0, 0].into())).unwrap();
        let query = guard.query();
        assert_eq!(query.len(), "?token=".len() + 2 * TOKEN_BYTES);
        assert_ne!(query, Guard::new(Some([0, 0, 0, 0].into())).unwrap().query());
        let host = [("host", "studio:8090")];
        assert!(is_accepted(&guard, &format!("/{query}"), &host));
        assert!(is_accepted(&guard, &format!("/photo/1{query}&x=1"), &host));
        for wrong in ["/", "/?token=", "/?token=0", &format!("/{query}0"), &format!("/{}", &query[..query.len() - 1])] {
            assert!(!is_accepted(&guard, wrong, &host), "{wrong}");
        }
        let foreign = [host[0], ("origin", "http://evil.example")];
        assert!(!is_accepted(&guard, &format!("/{query}"), &foreign));
    }
}
