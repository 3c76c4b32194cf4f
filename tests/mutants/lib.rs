//! The pure part of `spykee`: what moves the robot, what it speaks, and in which order it is said.
#![allow(dead_code, unused_imports)]

pub mod link {
    mod send_queue;
    mod speech;
    mod unsent;
}
pub mod pilot {
    mod silence;
    mod throttle;
}
pub mod robot;
pub mod safety;
pub mod wire;
