//! What a person sees who opens the page under a name that is not ours.

use axum::http::StatusCode;
use axum::response::{Html, IntoResponse as _, Response};

use super::origin_check::split;

const PAGE: &str = include_str!("unknown_host.html");

/// Says which addresses work, and how this name becomes one of them.
pub(super) fn page(host: Option<&str>) -> Response {
    let page = PAGE.replace("NAME", &name(host.unwrap_or_default()));
    (StatusCode::MISDIRECTED_REQUEST, Html(page)).into_response()
}

/// The name without its port, if it is one that the config can list; else a placeholder.
fn name(host: &str) -> String {
    let (name, _) = split(host);
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b".-".contains(&byte);
    if name.contains('.') && name.bytes().all(is_plain) {
        name.to_ascii_lowercase()
    } else {
        "robot.example.org".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_shown_unless_it_is_markup() {
        assert_eq!(name("Robot.example.com:7788"), "robot.example.com");
        for odd in ["", "[::1]:7788", "<b>x.y", "a.b\"c", "a.b}c"] {
            assert_eq!(name(odd), "robot.example.org", "{odd}");
        }
        assert_eq!(PAGE.matches("NAME").count(), 1);
    }
}
