//! `plumb update`, killed at any point and called again.
//!
//! Between the program and the bus stands a relay that reads what the program sends, and kills it
//! at a frame of its choice, which the bus still gets. Whatever that frame is, and whichever node
//! comes first, the same command then brings both nodes to the new program, and in both calls
//! together the time without a valid angle has the bound of an update that is not disturbed.

use std::thread;

use super::bench::{Bench, Shared, longest_without_an_angle};
use super::program::relay::{self, Next};
use super::program::{each_case, is_long, said};

/// A frame of the update of one node, in the order in which they come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Point {
    /// The first question of all.
    Question,
    /// NMT "enter PRE-OPERATIONAL".
    Leave,
    /// 1F51h: stop the program, which lets the memory be changed.
    Stop,
    /// 1F51h: clear the memory.
    Clear,
    /// 1F50h: the first block is asked for.
    Download,
    /// In the middle of the blocks.
    Middle,
    /// 1F51h: start the new program.
    Start,
    /// A question behind that: the image is checked, the node restarts, or is on trial.
    Trial,
    /// NMT "start" behind the trial.
    Return,
    /// The first question behind that: the pair comes together.
    Together,
}

const POINTS: [Point; 10] = [
    Point::Question,
    Point::Leave,
    Point::Stop,
    Point::Clear,
    Point::Download,
    Point::Middle,
    Point::Start,
    Point::Trial,
    Point::Return,
    Point::Together,
];

/// Frames between the request of a download and its middle.
const MIDDLE: usize = 60;

/// Where the first call is killed.
#[derive(Clone, Copy, Debug)]
struct Case {
    /// The order of the update.
    nodes: [u8; 2],
    /// At which of them, 0 or 1.
    which: usize,
    point: Point,
}

impl Case {
    /// All there are: both orders, both nodes of each, every point.
    fn all() -> Vec<Self> {
        let orders = [[1, 2], [2, 1]].into_iter();
        let nodes = orders.flat_map(|nodes| [0, 1].map(|which| (nodes, which)));
        let cases = nodes.flat_map(|(nodes, which)| {
            POINTS.map(|point| Self {
                nodes,
                which,
                point,
            })
        });
        cases.collect()
    }
}

/// What the program has sent to the node of a case.
struct Watch {
    case: Case,
    /// 1F51h sub 1 was written with 1.
    started: bool,
    /// NMT "start" has come behind that.
    returned: bool,
    /// Frames since the request of the first block.
    blocks: Option<usize>,
    /// Requests since the start of the new program.
    questions: usize,
}

impl Watch {
    const fn new(case: Case) -> Self {
        Self {
            case,
            started: false,
            returned: false,
            blocks: None,
            questions: 0,
        }
    }

    /// Whether this frame is the point.
    fn is_reached(&mut self, id: u16, data: &[u8]) -> bool {
        let node = self.case.nodes[self.case.which];
        let request = id == 0x600 + u16::from(node);
        let program = |order| request && data.starts_with(&[0x2F, 0x51, 0x1F, 1, order]);
        let nmt = |command| id == 0 && *data == [command, node];
        let any = (0x601..=0x67F).contains(&id);
        let first_block = request && data.get(1..4) == Some(&[0x50, 0x1F, 1]) && data[0] == 0xC6;
        if first_block {
            self.blocks = Some(0);
        }
        let block = self.blocks.filter(|_| request);
        self.blocks = self.blocks.map(|blocks| blocks + usize::from(request));
        self.questions += usize::from(request && self.started);
        let together = self.returned && any;
        let back = self.started && nmt(1);
        self.started |= program(1);
        self.returned |= back;
        match self.case.point {
            Point::Question => request,
            Point::Leave => nmt(128),
            Point::Stop => program(0),
            Point::Clear => program(3),
            Point::Download => first_block,
            Point::Middle => block == Some(MIDDLE),
            Point::Start => program(1),
            Point::Trial => self.questions == 2,
            Point::Return => back,
            Point::Together => together,
        }
    }
}

/// Runs the update through a relay up to its point, where it is killed; whether it got there.
fn killed(bench: &Bench, image: &str, case: Case) -> bool {
    let (mut watch, mut reached) = (Watch::new(case), false);
    let words = ["update", image, "--nodes", &order(case)];
    relay::run(&bench.bus, &words, |program, id, data| {
        if !watch.is_reached(id, data) {
            return Next::Goes;
        }
        program.kill().unwrap();
        program.wait().unwrap();
        reached = true;
        Next::Ends
    });
    reached
}

fn order(case: Case) -> String {
    case.nodes.map(|node| node.to_string()).join(",")
}

/// What came of a killed update and of the same command after it.
#[derive(Debug)]
struct Outcome {
    /// The first call got to its point.
    reached: bool,
    /// Exit status, output and errors of the second call.
    again: (Option<i32>, String, String),
    /// The longest time without a valid angle, in both calls, s of the bus.
    longest: f64,
}

impl Outcome {
    fn of(case: Case) -> Self {
        let bench = Bench::serving(&[]);
        let image = bench.image("1.0.0", &[]);
        let shared = Shared::default();
        let (reached, again, (longest, _)) = thread::scope(|scope| {
            let watch = scope.spawn(|| longest_without_an_angle(&bench.bus, &shared));
            shared.await_work();
            let reached = killed(&bench, &image, case);
            let again = said(&bench.update(&image, &["--nodes", &order(case)]));
            shared.end();
            (reached, again, watch.join().unwrap())
        });
        Self {
            reached,
            again,
            longest,
        }
    }

    /// Both nodes run the new program, and the pair was never long without an angle.
    fn is_sound(&self) -> bool {
        let (status, out, _) = &self.again;
        let lines = [1, 2].map(|node| format!("node {node} runs 1.0.0"));
        let run = lines.iter().all(|line| out.contains(line));
        let angle = self.longest > 0.0 && self.longest < 2.0;
        self.reached && *status == Some(0) && run && angle
    }
}

/// What went wrong with a case, if anything did.
fn carry_out(case: Case) -> Option<String> {
    let outcome = Outcome::of(case);
    (!outcome.is_sound()).then(|| format!("{case:?}: {outcome:?}"))
}

/// Node 1 was left PRE-OPERATIONAL, so the second call took the only channel at work out as well.
#[test]
fn an_update_after_a_killed_one_took_the_only_channel_at_work_out() {
    let outcome = Outcome::of(Case {
        nodes: [1, 2],
        which: 0,
        point: Point::Middle,
    });
    assert!(outcome.is_sound(), "{outcome:?}");
    let lines: Vec<_> = outcome.again.1.lines().collect();
    assert_eq!(lines[0], "node 1 was not OPERATIONAL, and is started");
    assert!(lines.contains(&"node 1 runs 1.0.0 now"), "{lines:?}");
    assert_eq!(lines.last(), Some(&"node 2 runs 1.0.0 now"));
}

/// A long run tries every case; any other one of each kind: a node that leaves, one amid its
/// download, one that restarts, one that comes back, in both orders and at both nodes.
#[test]
fn an_update_killed_at_any_point_is_brought_to_its_end() {
    let chosen = [
        ([1, 2], 0, Point::Leave),
        ([2, 1], 0, Point::Middle),
        ([1, 2], 1, Point::Trial),
        ([2, 1], 1, Point::Return),
    ];
    let few = chosen.map(|(nodes, which, point)| Case {
        nodes,
        which,
        point,
    });
    each_case(
        if is_long() { Case::all() } else { few.to_vec() },
        carry_out,
    );
}
