//! Why `plumb serve` did not start, or has ended by itself: one sentence that states what to do.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use sim::bench::BenchError;

use crate::addresses::SOCKETCAND_AT;
use crate::words::reader::WordError;

/// An end that nobody asked for; exit status 2. Nothing is left open when one is returned.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Another program listens there already; the option that asks for it.
    #[error(
        "port {a} of {b} is in use: end the program that has it (another `plumb serve`?) or \
         choose another one with {1} {c}",
        a = .0.port(),
        b = .0.ip(),
        c = SocketAddr::new(.0.ip(), .0.port().wrapping_add(1).max(1024))
    )]
    PortInUse(SocketAddr, &'static str),
    /// The address can't be listened on; the option that asks for it.
    #[error(
        "cannot listen on {0}: {2}; choose an address of this machine with {1} ADDRESS:PORT, for \
         instance {SOCKETCAND_AT}"
    )]
    Listen(SocketAddr, &'static str, io::Error),
    /// A name that can't stand in a socketcand command.
    #[error("{0:?} can't name a bus: take 1 to 15 letters, digits, `-`, `_` or `.`")]
    BusName(String),
    /// No pseudo-terminal could be made.
    #[error("cannot make a pseudo-terminal: {0}; serve SLCAN over TCP instead")]
    Pty(io::Error),
    /// The kernel has no CAN at all; the interface that was asked for.
    #[error(
        "cannot open the CAN interface {0}: this system has no SocketCAN (on Linux: modprobe \
         can_raw); serve over TCP instead"
    )]
    NoKernelCan(String),
    /// There is no such interface.
    #[error(
        "there is no CAN interface {0}: see `ip link`, or make a virtual one with `ip link add \
         {0} type vcan` and `ip link set {0} up`"
    )]
    NoInterface(String),
    /// The interface is there but can't be used.
    #[error("cannot use the CAN interface {0}: {1}; is it up (`ip link show {0}`)?")]
    Interface(String, io::Error),
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
    /// The file of the script can't be read.
    #[error("cannot read the script {path}: {1}", path = .0.display())]
    ScriptFile(PathBuf, io::Error),
    /// The script is longer than so many kB.
    #[error(
        "the script {path} is longer than {1} kB; type the words from a program instead",
        path = .0.display()
    )]
    ScriptLong(PathBuf, u64),
    /// There is no word in the script.
    #[error(
        "there is no word in the script {path}: write at least `hold`, or omit --script",
        path = .0.display()
    )]
    ScriptEmpty(PathBuf),
    /// A line of the script, counted from 1, is wrong.
    #[error("{path} line {1}: {2}", path = .0.display())]
    ScriptLine(PathBuf, usize, Complaint),
    /// The script has ended, after so many seconds.
    #[error(
        "the script {path} has ended after {1:.1} s and nothing moves the instrument any more; \
         end it with `hold` to serve on, or with `repeat` to begin again",
        path = .0.display()
    )]
    ScriptEnded(PathBuf, f64),
    /// A file or the folder for the nodes' records can't be used.
    #[error("cannot keep the nodes' records in {path}: {1}", path = .0.display())]
    Keep(PathBuf, io::Error),
    /// A file with a record is not what was written.
    #[error(
        "{path} is damaged: delete it, and the node starts with its defaults",
        path = .0.display()
    )]
    Damaged(PathBuf),
    /// So many node-ids for so many nodes.
    #[error(
        "{0} node-id{a} for {1} nodes: --node-ids takes one for each, or none",
        a = if *.0 == 1 { "" } else { "s" }
    )]
    NodeIds(usize, usize),
    /// An instrument could not be calibrated.
    #[error("an instrument could not be calibrated: {0}")]
    Bench(BenchError),
    /// The end by Ctrl-C could not be arranged.
    #[error("cannot be ended by Ctrl-C ({0}), so not begun")]
    Signal(ctrlc::Error),
}

/// What is wrong with a line of a script.
#[derive(Debug, thiserror::Error)]
pub enum Complaint {
    /// A line that is none, or a pose in which no housing can stand.
    #[error(transparent)]
    Word(#[from] WordError),
    /// A time before that of an earlier line, s.
    #[error(
        "this time is over: the lines before it take {0} s; put the lines in the order of their \
         times"
    )]
    Backwards(f64),
    /// A line behind `hold`, `repeat` or `quit`.
    #[error("nothing behind `{0}` is carried out: take this line away or move it up")]
    NeverReached(&'static str),
    /// A script that would begin again at once, for ever.
    #[error("a script that repeats has to take time: put a `wait SECONDS` into it")]
    NoTime,
    /// Bytes that are no text.
    #[error("these bytes are no text: save the script as UTF-8")]
    NoText,
}
