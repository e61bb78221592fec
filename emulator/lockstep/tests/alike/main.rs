//! The emulator's own core beside one that we did not write: Unicorn's, which is QEMU's.
//!
//! Both execute the product's images through a life of them, and must agree on every frame with
//! its time, on the count of instructions, on registers, RAM and flash. Instructions that the
//! images do not have are drawn by seed ([`drawn`]). Left out: how fast either is.

mod drawn;

use canopen::Frame;
use emulator::build::Product;
use emulator::cortex_m3::CortexM3;
use emulator::cpu::{Cpu, Register};
use emulator::pair::{Heard, Pair};
use emulator_lockstep::UnicornCpu;
use flash::layout::{BASE, RAM, RC};
use sim::bench::{Mode, World};
use sim::network::guest::Switch;
use sim::network::hand::Pose;
use sim::network::instrument::Delivered;

/// "save", as 1010h wants it (CiA 301 7.5.2.13).
const SAVE: u32 = 0x6576_6173;

/// Where the housing turns to.
const TURNED: Pose = Pose {
    pitch_deg: 20.0,
    roll_deg: 40.0,
};

/// All that can be seen of a core.
pub fn registers(cpu: &impl Cpu) -> Vec<u32> {
    let named = [
        Register::Sp,
        Register::Lr,
        Register::Pc,
        Register::Xpsr,
        Register::Msp,
        Register::Psp,
        Register::Primask,
        Register::Basepri,
        Register::Faultmask,
        Register::Control,
    ];
    let all = (0..13).map(Register::R).chain(named);
    all.map(|register| cpu.register(register)).collect()
}

/// What a board has come to.
#[derive(Debug, PartialEq, Eq)]
struct State {
    instructions: u64,
    cycles: u64,
    registers: Vec<u32>,
    ram: Vec<u8>,
    flash: Vec<u8>,
}

fn states<C: Cpu + 'static>(pair: &mut Pair<C>) -> [State; 2] {
    [0, 1].map(|number| {
        let machine = pair.board(number).machine();
        let (mut ram, mut flash) = (vec![0; RC.ram as usize], vec![0; RC.flash as usize]);
        machine.cpu().read(RAM, &mut ram).expect("the RAM is there");
        machine
            .cpu()
            .read(BASE, &mut flash)
            .expect("the flash is there");
        State {
            instructions: machine.chip().instructions(),
            cycles: machine.chip().cycles(),
            registers: registers(machine.cpu()),
            ram,
            flash,
        }
    })
}

/// A part of the life of a pair.
type Step<C> = (&'static str, fn(&mut Pair<C>));

/// From power to power: SYNCs while it moves, objects read and refused, parameters stored, a reset
/// of one node, a program cleared away, a supply that is cut.
fn life<C: Cpu + 'static>() -> [Step<C>; 7] {
    [
        ("start", |pair| pair.run(0.6)),
        ("SYNCs while it turns", |pair| {
            pair.send(Frame::data_frame(0, &[1, 0])).expect("room");
            pair.hand.go(TURNED);
            pair.run_synced(40).expect("room");
        }),
        ("objects", |pair| {
            for (index, sub) in [
                (0x1000, 0),
                (0x1018, 4),
                (0x6010, 0),
                (0x2500, 0),
                (0x1800, 9),
            ] {
                let _ = pair.read(1, index, sub);
            }
            let _ = pair.write(2, (0x1017, 0), 2, 150);
        }),
        ("parameters stored", |pair| {
            pair.send(Frame::data_frame(0, &[0x80, 1])).expect("room");
            pair.run(0.01);
            pair.write(1, (0x1010, 1), 4, SAVE).expect("it stores");
            pair.run(0.2);
        }),
        ("a node reset", |pair| {
            pair.send(Frame::data_frame(0, &[0x81, 2])).expect("room");
            pair.run(0.5);
        }),
        ("a program cleared", |pair| {
            let _ = pair.write(1, (0x1F51, 1), 1, 0);
            let _ = pair.write(1, (0x1F51, 1), 1, 3);
            pair.run(0.3);
        }),
        ("power", |pair| {
            for switch in [Switch::Off, Switch::On] {
                pair.network.switch_guest(0, switch);
                pair.run(0.3);
            }
        }),
    ]
}

#[test]
fn the_product_lives_alike_on_two_cores() {
    let product = Product::build().expect("the images build");
    let delivered = Delivered::calibrated(Mode::Product, &World::NOMINAL, 1, 0);
    let delivered = delivered.expect("the bench calibrates them");
    let pieces = product.pieces();
    let own = Pair::<CortexM3>::delivered_with(&delivered, 1, &pieces);
    let other = Pair::<UnicornCpu>::delivered_with(&delivered, 1, &pieces);
    let (mut own, mut other) = (own.expect("it fits"), other.expect("it fits"));
    for ((name, act), (_, act_too)) in life().into_iter().zip(life()) {
        act(&mut own);
        act_too(&mut other);
        same_frames(name, &own.heard, &other.heard);
        for (number, (own, other)) in states(&mut own).iter().zip(states(&mut other)).enumerate() {
            assert_eq!(
                own.instructions, other.instructions,
                "{name}, board {number}"
            );
            assert_eq!(own.registers, other.registers, "{name}, board {number}");
            assert!(
                *own == other,
                "{name}, board {number}: memory or cycles differ"
            );
        }
    }
    let instructions = states(&mut own).map(|state| state.instructions);
    eprintln!(
        "{} frames, {instructions:?} instructions, alike",
        own.heard.len()
    );
}

/// The first frame that differs is the one to look at.
fn same_frames(name: &str, own: &[Heard], other: &[Heard]) {
    for (number, (own, other)) in own.iter().zip(other).enumerate() {
        assert_eq!(own, other, "{name}: frame {number}");
    }
    assert_eq!(own.len(), other.len(), "{name}");
}
