//! The pure half of `spykee`: what moves the robot, and what it speaks.
#![allow(dead_code, unused_imports)]

pub mod robot;
pub mod safety;
pub mod wire;
