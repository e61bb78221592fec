//! Why a bus could not be joined: one sentence that says where, what, and what to do.

use std::fmt;
use std::io;

/// Why a bus could not be joined.
#[derive(Debug)]
pub enum JoinError {
    /// `--bus` and one of the other ways to name a bus; the flag.
    Both(&'static str),
    /// A name that is no bus's.
    Address(String),
    /// An interface's kind that is not known.
    Interface(String),
    /// A bit rate that isn't a number of bit/s which SLCAN has a letter for.
    BitRate(String),
    /// Nobody listens there.
    Refused(String),
    /// Who listens there does not answer as it should: the bus, and what it said.
    Stranger(String, String),
    /// There is no such serial port.
    NoAdapter(String),
    /// The serial port may not be used.
    Forbidden(String),
    /// The serial port is another program's.
    PortInUse(String),
    /// The kernel has no CAN; the interface.
    NoKernelCan(String),
    /// There is no such interface.
    NoInterface(String),
    /// The interface is down.
    Down(String),
    /// Something else: the bus, and what the system says.
    System(String, io::Error),
    /// Signals can't be watched.
    Signal(String),
}

impl JoinError {
    /// A server that could not be joined.
    pub fn at(bus: &str, at: &str, error: io::Error) -> Self {
        use io::ErrorKind as Kind;
        match error.kind() {
            Kind::ConnectionRefused => Self::Refused(at.to_owned()),
            Kind::InvalidData | Kind::TimedOut | Kind::UnexpectedEof => {
                Self::Stranger(bus.to_owned(), said(&error))
            }
            _ => Self::System(bus.to_owned(), error),
        }
    }

    /// A serial port that could not be used.
    pub fn port(path: &str, error: io::Error) -> Self {
        use io::ErrorKind as Kind;
        match error.kind() {
            Kind::NotFound => Self::NoAdapter(path.to_owned()),
            Kind::PermissionDenied => Self::Forbidden(path.to_owned()),
            Kind::ResourceBusy => Self::PortInUse(path.to_owned()),
            Kind::InvalidData | Kind::TimedOut | Kind::UnexpectedEof => {
                Self::Stranger(path.to_owned(), said(&error))
            }
            _ => Self::System(path.to_owned(), error),
        }
    }

    /// An interface of the kernel that could not be used.
    #[cfg(target_os = "linux")]
    pub fn interface(name: &str, error: io::Error) -> Self {
        use rustix::io::Errno;
        match error.raw_os_error().map(Errno::from_raw_os_error) {
            Some(Errno::AFNOSUPPORT | Errno::PROTONOSUPPORT) => Self::NoKernelCan(name.to_owned()),
            Some(Errno::NODEV | Errno::NXIO) => Self::NoInterface(name.to_owned()),
            Some(Errno::NETDOWN) => Self::Down(name.to_owned()),
            _ => Self::System(name.to_owned(), error),
        }
    }
}

fn said(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::TimedOut => "it does not answer".to_owned(),
        io::ErrorKind::UnexpectedEof => "it hangs up".to_owned(),
        _ => error.to_string(),
    }
}

impl std::error::Error for JoinError {}

impl fmt::Display for JoinError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Both(flag) => {
                write!(f, "--bus and {flag} both name a bus: give one of them")
            }
            Self::Address(text) => write!(
                f,
                "{text:?} is no bus: write socketcand://HOST:PORT/NAME, slcan://HOST:PORT, \
                 slcan:///dev/ttyACM0 or socketcan://can0"
            ),
            Self::Interface(text) => write!(
                f,
                "{text:?} is no kind of interface: take socketcand, slcan or socketcan"
            ),
            Self::BitRate(text) => write!(
                f,
                "{text:?} is no bit rate that is known here: take 10000, 20000, 50000, 100000, \
                 125000, 250000, 500000, 800000 or 1000000"
            ),
            Self::Refused(at) => write!(
                f,
                "nobody listens at {at}: start `plumb serve`, or name the bus with --bus"
            ),
            Self::Stranger(bus, said) => write!(
                f,
                "who listens at {bus} is no CAN adapter of this kind ({said}): look at address \
                 and interface"
            ),
            device => device.fmt_device(f),
        }
    }
}

impl JoinError {
    /// The sentence about something that this computer has, or has not.
    fn fmt_device(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAdapter(path) => write!(
                f,
                "there is no serial port {path}: is the adapter plugged in, and is that its name?"
            ),
            Self::Forbidden(path) => write!(
                f,
                "the serial port {path} may not be used by you: on Linux join the group that owns \
                 it (`ls -l {path}`), often dialout, and log in again"
            ),
            Self::PortInUse(path) => {
                write!(
                    f,
                    "another program has the serial port {path}: end it first"
                )
            }
            Self::NoKernelCan(name) => write!(
                f,
                "cannot open the CAN interface {name}: this system has no SocketCAN (on Linux: \
                 modprobe can_raw)"
            ),
            Self::NoInterface(name) => write!(
                f,
                "there is no CAN interface {name}: see `ip link`; for `plumb serve` or another \
                 server give --bus HOST:PORT"
            ),
            Self::Down(name) => write!(
                f,
                "the CAN interface {name} is down: `ip link set {name} up type can bitrate 250000`"
            ),
            Self::System(bus, error) => write!(f, "cannot join the bus {bus}: {error}"),
            Self::Signal(error) => write!(f, "cannot watch signals: {error}"),
            // The others name no device.
            _ => Ok(()),
        }
    }
}
