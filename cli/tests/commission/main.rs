//! The verbs that commission an instrument from the outside, against the nodes of `plumb serve`.

mod bench;
mod silence;
mod verbs;
