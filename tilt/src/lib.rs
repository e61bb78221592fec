//! Sensor counts in, angle or a reason out.
#![no_std]
#[cfg(test)]
extern crate std;

pub mod sample;
