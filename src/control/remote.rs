//! A run on another computer, reached over the network: the same requests and answers as through
//! the private socket.

use std::io;
use std::time::Duration;

use ureq::http::{HeaderValue, Request};

use super::client::{AskError, MAX_ANSWER, parse_answer};
use super::request::RunRequest;
use super::response::RunResponse;
use crate::config::ServiceUrl;

/// The address of a service, and the token for access to it.
#[derive(Debug, Clone)]
pub struct Remote {
    url: ServiceUrl,
    token: Option<HeaderValue>,
}

/// The token is not valid in a header field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the token contains characters that are not allowed in a token")]
pub struct TokenError;

impl Remote {
    /// A service at this address, with this token.
    ///
    /// # Errors
    /// See [`TokenError`].
    pub fn new(url: ServiceUrl, token: Option<&str>) -> Result<Remote, TokenError> {
        let token = token.map(|token| {
            let field = HeaderValue::from_str(&format!("Bearer {token}"));
            field.map(|mut field| {
                field.set_sensitive(true);
                field
            })
        });
        let token = token.transpose().map_err(|_| TokenError)?;
        Ok(Remote { url, token })
    }

    /// The address.
    pub fn url(&self) -> &ServiceUrl {
        &self.url
    }

    /// Sends one request and waits for the answer at most this long. Blocks the calling thread.
    ///
    /// # Errors
    /// See [`AskError`].
    pub fn ask(&self, request: &RunRequest, limit: Duration) -> Result<RunResponse, AskError> {
        let call = request.to_http();
        let http_request = Request::builder()
            .method(call.method)
            .uri(format!("{}{}", self.url, call.path))
            .header("content-type", call.content_type)
            .body(call.body);
        let mut http_request =
            http_request.map_err(|error| AskError::Io(io::Error::other(error)))?;
        if let Some(token) = &self.token {
            http_request
                .headers_mut()
                .insert("authorization", token.clone());
        }
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .timeout_global(Some(limit))
            .http_status_as_error(false)
            .max_redirects(0)
            .user_agent(concat!("spykee/", env!("CARGO_PKG_VERSION")))
            .build()
            .into();
        let failed = |error: ureq::Error| match error {
            ureq::Error::Timeout(_) => AskError::TimedOut(limit),
            ureq::Error::Io(error) => AskError::Io(error),
            other => AskError::Io(io::Error::other(other)),
        };
        let mut answer = agent.run(http_request).map_err(failed)?;
        let status = answer.status();
        let body = answer.body_mut().with_config().limit(MAX_ANSWER as u64);
        let body = body.read_to_vec().map_err(failed)?;
        parse_answer(status, body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_token_is_checked_and_never_shown() {
        let url: ServiceUrl = "http://10.0.0.7:7788".parse().unwrap();
        let remote = Remote::new(url.clone(), Some("s3cr3t")).unwrap();
        assert!(!format!("{remote:?}").contains("s3cr3t"));
        assert_eq!(Remote::new(url, Some("a\nb")).unwrap_err(), TokenError);
    }
}
