//! Why a bus could not be joined: one sentence that states where, what, and what to do.

use std::io;

/// Why a bus could not be joined.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    /// `--bus` and one of the other ways to name a bus; the flag.
    #[error("--bus and {0} both name a bus: give one of them")]
    Both(&'static str),
    /// A name that is no bus's.
    #[error(
        "{0:?} is no bus: write socketcand://HOST:PORT/NAME, slcan://HOST:PORT, \
         slcan:///dev/ttyACM0 or socketcan://can0"
    )]
    Address(String),
    /// An interface's kind that is not known.
    #[error("{0:?} is no kind of interface: take socketcand, slcan or socketcan")]
    Interface(String),
    /// A bit rate that isn't a number of bit/s which SLCAN has a letter for.
    #[error(
        "{0:?} is no bit rate that is known here: take 10000, 20000, 50000, 100000, 125000, \
         250000, 500000, 800000 or 1000000"
    )]
    BitRate(String),
    /// Nobody listens there.
    #[error("nothing accepts a connection at {0}: start `plumb serve`, or name the bus with --bus")]
    Refused(String),
    /// Who listens there does not answer as it should: the bus, and what it said.
    #[error(
        "the device at {0} is no CAN adapter of this kind ({1}): look at address and interface"
    )]
    Stranger(String, String),
    /// There is no such serial port.
    #[error("there is no serial port {0}: is the adapter plugged in, and is that its name?")]
    NoAdapter(String),
    /// The serial port may not be used.
    #[error(
        "the serial port {0} may not be used by you: on Linux join the group that owns it (`ls -l \
         {0}`), often dialout, and log in again"
    )]
    Forbidden(String),
    /// The serial port is another program's.
    #[error("another program has the serial port {0}: end it first")]
    PortInUse(String),
    /// The kernel has no CAN; the interface.
    #[error(
        "cannot open the CAN interface {0}: this system has no SocketCAN (on Linux: modprobe \
         can_raw)"
    )]
    NoKernelCan(String),
    /// There is no such interface.
    #[error(
        "there is no CAN interface {0}: see `ip link`; for `plumb serve` or another server give \
         --bus HOST:PORT"
    )]
    NoInterface(String),
    /// The interface is down.
    #[error("the CAN interface {0} is down: `ip link set {0} up type can bitrate 250000`")]
    Down(String),
    /// Something else: the bus, and what the system reports.
    #[error("cannot join the bus {0}: {1}")]
    System(String, io::Error),
    /// Signals can't be watched.
    #[error("cannot handle signals: {0}")]
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
        use can_text::kernel::Unusable;
        match Unusable::of(&error) {
            Unusable::NoKernelCan => Self::NoKernelCan(name.to_owned()),
            Unusable::NoInterface => Self::NoInterface(name.to_owned()),
            Unusable::Down => Self::Down(name.to_owned()),
            Unusable::Other => Self::System(name.to_owned(), error),
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
