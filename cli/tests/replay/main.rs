//! `plumb replay` as a person runs it: the binary, files, exit status, stdout and stderr.

mod bad_input;
mod bench;
mod documents;
mod good_runs;
mod gyroscope;
