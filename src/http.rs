//! HTTP for people and programs: a server with bounded resources on one address, and a guard in
//! front of everything it serves. Independent of the robot.
//!
//! The guard answers three questions about each request before anything else sees it. Is it meant
//! for us (`Host`, against DNS rebinding)? Did our own page send it (`Origin`)? Who sends it
//! (session, token, or anyone, on loopback without a password)? Requests that fail are rejected
//! here.

mod access;
mod attempts;
mod guard;
mod keyring;
mod listener;
mod login;
mod middleware;
mod options;
mod refusal;
mod role;
mod secret;
mod sessions;

pub use access::{Access, AccessError};
pub use keyring::{Keyring, KeyringError, Listed};
pub use listener::{LimitedListener, Peer};
pub use login::{Me, routes};
pub use middleware::{Driver, guard_request};
pub use options::Options;
pub use refusal::Refusal;
pub use role::{Role, Visitor};
