//! HTTP for people and programs: a server with bounded resources on one address, and a check in
//! front of everything it serves. Independent of the robot.
//!
//! The check of the origin answers three questions about each request before anything else sees it.
//! Is it meant for us (`Host`, against DNS rebinding)? Did our own page send it (`Origin`)? Who
//! sends it (a token in a header or in the page's cookie, or anyone, on loopback without tokens)?
//! Requests that fail are rejected here.

mod access;
mod keyring;
mod listener;
mod login;
mod middleware;
mod options;
mod origin_check;
mod visitor;

pub use access::{Access, AccessError};
pub use keyring::{Key, Keyring, KeyringError, Role};
pub use listener::serve;
pub use login::{Me, routes};
pub use middleware::guard_request;
pub use options::Options;
pub use visitor::{Driver, Refusal, Visitor};
