//! The program `plumb`; all of it is in the library, so that others can serve a bus as it does.

use std::process::ExitCode;

fn main() -> ExitCode {
    plumb::run()
}
