//! `plumb monitor`: what happens on a bus, or has happened in a log, as it is seen.
mod events;
mod load;
mod model;
mod moment;
mod pace;
mod snapshot;
mod trace;
mod words;

#[cfg(test)]
mod model_tests;
