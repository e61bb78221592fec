//! The verbs of the bench from the outside: `plumb calibrate`, `characterise` and `verify`, against
//! the nodes of `plumb serve`.

mod calibrate;
mod careful_motor;
mod characterise;
mod parts;
#[path = "../program/mod.rs"]
mod program;
mod restore;
mod stand;
mod temperature;
