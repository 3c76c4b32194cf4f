//! The pure parts of `spykee`: the safety rules, the wire protocol, the robot's types, and parts of
//! link and pilot.
#![allow(dead_code, unused_imports)]

pub mod link {
    mod pace;
    mod send_queue;
}
pub mod pilot {
    mod silence;
    mod throttle;
}
mod rate_limit;
pub mod robot;
pub mod safety;
pub mod wire;
