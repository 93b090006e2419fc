//! Who may ask: Host, Origin and token of a request.

use std::net::IpAddr;

use anyhow::{Result, bail};
use axum::http::header::{HOST, HeaderName, ORIGIN};
use axum::http::{HeaderMap, Uri};

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const TOKEN_BYTES: usize = 16;

/// The conditions that a request must meet.
#[derive(Debug)]
pub(crate) struct Guard {
    /// Part of the link if others have access.
    token: Option<String>,
    /// The origin of a front that passes requests on, such as `https://host`.
    origin: Option<String>,
}

impl Guard {
    /// `bind`: the address given, `origin`: that of a front; with neither only requests to a local host name are
    /// accepted.
    pub(crate) fn new(bind: Option<IpAddr>, origin: Option<&str>) -> Result<Self> {
        let origin = origin.map(|url| url.trim_end_matches('/'));
        if let Some(url) = origin
            && !url.split_once("://").is_some_and(|(scheme, host)| {
                (scheme == "https" || scheme == "http") && !host.is_empty() && !host.contains(['/', '?', '#', '@', ' '])
            })
        {
            bail!("--origin {url}: expected a scheme and a host, such as https://host.example");
        }
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| anyhow::anyhow!("no random numbers for a token: {error}"))?;
        let is_open = bind.is_some() || origin.is_some();
        let token = is_open.then(|| bytes.iter().map(|byte| format!("{byte:02x}")).collect());
        Ok(Self { token, origin: origin.map(str::to_owned) })
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
        let is_own = |origin: &str| {
            origin.eq_ignore_ascii_case(&format!("http://{host}"))
                || self.origin.as_ref().is_some_and(|front| origin.eq_ignore_ascii_case(front))
        };
        if header(ORIGIN).is_some_and(|origin| !is_own(origin)) {
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
        let guard = Guard::new(None, None).unwrap();
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
            assert_eq!(is_accepted(&guard, "/picture", &[host, (name, value)]), expected, "{name}: {value}");
        }
    }

    #[test]
    fn with_bind_the_token_is_required() {
        let guard = Guard::new(Some([0, 0, 0, 0].into()), None).unwrap();
        let query = guard.query();
        assert_eq!(query.len(), "?token=".len() + 2 * TOKEN_BYTES);
        assert_ne!(query, Guard::new(Some([0, 0, 0, 0].into()), None).unwrap().query());
        let host = [("host", "studio:8090")];
        assert!(is_accepted(&guard, &format!("/{query}"), &host));
        assert!(is_accepted(&guard, &format!("/photo/1{query}&x=1"), &host));
        for wrong in ["/", "/?token=", "/?token=0", &format!("/{query}0"), &format!("/{}", &query[..query.len() - 1])] {
            assert!(!is_accepted(&guard, wrong, &host), "{wrong}");
        }
        let foreign = [host[0], ("origin", "http://evil.example")];
        assert!(!is_accepted(&guard, &format!("/{query}"), &foreign));
    }

    #[test]
    fn one_front_is_admitted_with_the_token() {
        let guard = Guard::new(None, Some("https://front.example/")).unwrap();
        let with_token = format!("/{}", guard.query());
        let from = |origin| [("host", "127.0.0.1:8090"), ("origin", origin)];
        assert!(is_accepted(&guard, &with_token, &from("https://front.example")));
        assert!(is_accepted(&guard, &with_token, &[("host", "front.example"), ("origin", "https://FRONT.example")]));
        assert!(!is_accepted(&guard, "/", &from("https://front.example")));
        for origin in ["https://other.example", "http://front.example", "https://front.example.evil.example", "null"] {
            assert!(!is_accepted(&guard, &with_token, &from(origin)), "{origin}");
        }
        for url in ["front.example", "ftp://front.example", "https://", "https://front.example/a", "https://a@b"] {
            let refused = Guard::new(None, Some(url)).unwrap_err().to_string();
            assert!(refused.contains("--origin") && refused.contains("expected"), "{refused}");
        }
    }
}
