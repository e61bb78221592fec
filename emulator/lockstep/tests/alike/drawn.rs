//! Instructions drawn by seed, each executed by itself on both cores.
//!
//! A form is written as the manual writes it: 0 and 1 are fixed, a letter is a register wherever it
//! stands, `i` any bit. Registers are what an instruction may have anywhere: neither the stack
//! pointer nor the program counter. Left out: branches and what changes the core's state, of which
//! the images have every kind; STREX, whose monitor Unicorn does not clear as an exception does.
//!
//! Source of the forms: ARMv7-M A5.2, A5.3.

use std::cell::RefCell;
use std::rc::Rc;

use emulator::chip::{Chip, Individual};
use emulator::cortex_m3::CortexM3;
use emulator::cpu::{Cpu, Fault, Register, Stop};
use emulator::exceptions::IT_STATE;
use emulator_lockstep::UnicornCpu;
use flash::layout::{BASE, RAM, RC};
use sim::lis2dw12::{self, Traits};
use sim::rng::Rng;

use super::registers;

/// Bytes of a place: IT, an instruction of 32 bits, WFI.
const PLACE: usize = 8;
const WFI: u16 = 0xBF30;
/// Where xPSR and the program counter are among the registers that are compared.
const XPSR: usize = 16;
const PC: usize = 15;

/// Forms of 16 bits.
const NARROW: [&str; 36] = [
    "00000iiiiimmmddd",
    "00001iiiiimmmddd",
    "00010iiiiimmmddd",
    "0001100mmmnnnddd",
    "0001101mmmnnnddd",
    "0001110iiinnnddd",
    "0001111iiinnnddd",
    "00100dddiiiiiiii",
    "00101nnniiiiiiii",
    "00110dddiiiiiiii",
    "00111dddiiiiiiii",
    "01000000immmdddd",
    "010000iiiimmmddd",
    "010001000mmmmddd",
    "010001011mmmm0nn",
    "010001100mmmmddd",
    "01001tttiiiiiiii",
    "0101iiimmmnnnttt",
    "01100iiiiinnnttt",
    "01101iiiiinnnttt",
    "01110iiiiinnnttt",
    "01111iiiiinnnttt",
    "10000iiiiinnnttt",
    "10001iiiiinnnttt",
    "10010tttiiiiiiii",
    "10011tttiiiiiiii",
    "10100dddiiiiiiii",
    "10101dddiiiiiiii",
    "10110000iiiiiiii",
    "10110010iimmmddd",
    "1011101000mmmddd",
    "1011101001mmmddd",
    "1011101011mmmddd",
    "1011010iiiiiiiii",
    "10111100iiiiiiii",
    "11001nnniiiiiiii",
];

/// Forms of 32 bits.
const WIDE: [&str; 79] = [
    // Data processing with a shifted register.
    "11101010000innnn0iiiddddiiiimmmm",
    "11101010001innnn0iiiddddiiiimmmm",
    "11101010010innnn0iiiddddiiiimmmm",
    "11101010011innnn0iiiddddiiiimmmm",
    "11101010100innnn0iiiddddiiiimmmm",
    "11101011000innnn0iiiddddiiiimmmm",
    "11101011010innnn0iiiddddiiiimmmm",
    "11101011011innnn0iiiddddiiiimmmm",
    "11101011101innnn0iiiddddiiiimmmm",
    "11101011110innnn0iiiddddiiiimmmm",
    "111010100001nnnn0iii1111iiiimmmm",
    "111010101001nnnn0iii1111iiiimmmm",
    "111010110001nnnn0iii1111iiiimmmm",
    "111010111011nnnn0iii1111iiiimmmm",
    "11101010010i11110iiiddddiiiimmmm",
    "11101010011i11110iiiddddiiiimmmm",
    // Data processing with a constant.
    "11110i00000innnn0iiiddddiiiiiiii",
    "11110i00001innnn0iiiddddiiiiiiii",
    "11110i00010innnn0iiiddddiiiiiiii",
    "11110i00011innnn0iiiddddiiiiiiii",
    "11110i00100innnn0iiiddddiiiiiiii",
    "11110i01000innnn0iiiddddiiiiiiii",
    "11110i01010innnn0iiiddddiiiiiiii",
    "11110i01011innnn0iiiddddiiiiiiii",
    "11110i01101innnn0iiiddddiiiiiiii",
    "11110i01110innnn0iiiddddiiiiiiii",
    "11110i000001nnnn0iii1111iiiiiiii",
    "11110i010001nnnn0iii1111iiiiiiii",
    "11110i011011nnnn0iii1111iiiiiiii",
    "11110i00010i11110iiiddddiiiiiiii",
    "11110i00011i11110iiiddddiiiiiiii",
    // Plain constants, bit fields, saturation.
    "11110i100000nnnn0iiiddddiiiiiiii",
    "11110i101010nnnn0iiiddddiiiiiiii",
    "11110i100100iiii0iiiddddiiiiiiii",
    "11110i101100iiii0iiiddddiiiiiiii",
    "111100110100nnnn0iiiddddii0iiiii",
    "111100111100nnnn0iiiddddii0iiiii",
    "111100110110nnnn0iiiddddii0iiiii",
    "11110011011011110iiiddddii0iiiii",
    "1111001100i0nnnn0iiiddddii0iiiii",
    "1111001110i0nnnn0iiiddddii0iiiii",
    // Loads and stores.
    "111110001101nnnnttttiiiiiiiiiiii",
    "111110001100nnnnttttiiiiiiiiiiii",
    "111110001001nnnnttttiiiiiiiiiiii",
    "111110001000nnnnttttiiiiiiiiiiii",
    "111110001011nnnnttttiiiiiiiiiiii",
    "111110001010nnnnttttiiiiiiiiiiii",
    "111110011001nnnnttttiiiiiiiiiiii",
    "111110011011nnnnttttiiiiiiiiiiii",
    "111110000101nnnntttt000000iimmmm",
    "111110000100nnnntttt000000iimmmm",
    "111110010011nnnntttt000000iimmmm",
    "11111000010innnntttt1100iiiiiiii",
    "11111000001innnntttt1101iiiiiiii",
    "11111000000innnntttt1111iiiiiiii",
    "11111000010innnntttt1001iiiiiiii",
    "111110010001nnnntttt1011iiiiiiii",
    "11111000i1011111ttttiiiiiiiiiiii",
    "11101001i10innnnttttssssiiiiiiii",
    "11101001i11innnnttttssssiiiiiiii",
    "11101000i11innnnttttssssiiiiiiii",
    "1110100010i1nnnn0i0iiiiiiiiiiiii",
    "1110100010i0nnnn0i0iiiiiiiiiiiii",
    "1110100100i1nnnn0i0iiiiiiiiiiiii",
    "1110100100i0nnnn0i0iiiiiiiiiiiii",
    // Shifts by a register, extensions, other orders, products, quotients, flags.
    "111110100iiinnnn1111dddd0000mmmm",
    "111110100i0i11111111dddd10iimmmm",
    "111110101001mmmm1111dddd10iimmmm",
    "111110101011mmmm1111dddd1000mmmm",
    "111110110000nnnnaaaadddd0000mmmm",
    "111110110000nnnn1111dddd0000mmmm",
    "111110110000nnnnaaaadddd0001mmmm",
    "111110111000nnnnllllhhhh0000mmmm",
    "111110111010nnnnllllhhhh0000mmmm",
    "111110111100nnnnllllhhhh0000mmmm",
    "111110111110nnnnllllhhhh0000mmmm",
    "111110111001nnnn1111dddd1111mmmm",
    "111110111011nnnn1111dddd1111mmmm",
    "11110011111011111000dddd00000000",
];

fn below(rng: &mut Rng, end: u32) -> u32 {
    (rng.uniform() * f64::from(end)) as u32 % end
}

fn word(rng: &mut Rng) -> u32 {
    below(rng, 1 << 16) << 16 | below(rng, 1 << 16)
}

/// An instruction of this form, and the registers that its letters became.
fn filled(rng: &mut Rng, form: &str) -> (u32, Vec<(char, u32)>) {
    let (mut code, mut taken) = (0, Vec::<(char, u32)>::new());
    let mut rest = form;
    while let Some(letter) = rest.chars().next() {
        let run = rest.chars().take_while(|next| *next == letter).count();
        let run = if matches!(letter, '0' | '1' | 'i') {
            1
        } else {
            run
        };
        let value = match letter {
            '0' | '1' => u32::from(letter == '1'),
            'i' => below(rng, 2),
            _ => {
                let known = taken.iter().find(|(before, _)| *before == letter);
                let known = known.map(|(_, value)| *value);
                known.unwrap_or_else(|| {
                    loop {
                        let number = below(rng, 1 << run);
                        if number != 13 && number != 15 {
                            taken.push((letter, number));
                            break number;
                        }
                    }
                })
            }
        };
        code = code << run | value;
        rest = &rest[run..];
    }
    (code, taken)
}

/// Whether the manual defines what it does (its "UNPREDICTABLE" left out).
fn is_defined(form: &str, code: u32, taken: &[(char, u32)]) -> bool {
    let register = |letter| {
        taken
            .iter()
            .find(|(is, _)| *is == letter)
            .map(|(_, number)| *number)
    };
    let same = |one, other| register(one).is_some() && register(one) == register(other);
    if form.len() == 16 {
        let list = code & 0x1FF;
        return match form {
            "1011010iiiiiiiii" => list != 0,
            "10111100iiiiiiii" | "11001nnniiiiiiii" => list & 0xFF != 0,
            _ => true,
        };
    }
    let walks = code >> 21 & 1 != 0;
    let list = code & 0xFFFF;
    let (lsb, low) = (code >> 10 & 0x1C | code >> 6 & 3, code & 31);
    match &form[..7] {
        "1110100" if form.contains("ssss") => {
            !same('t', 's') && !(walks && (same('n', 't') || same('n', 's')))
        }
        "1110100" => {
            let base = register('n').is_some_and(|n| list >> n & 1 != 0);
            list.count_ones() >= 2 && !(walks && base)
        }
        "1111100" => !same('n', 't'),
        "1111000" | "11110i0" | "11110i1" if code >> 25 & 1 == 0 && form.starts_with("11110i0") => {
            // A pattern of a byte that is 0.
            code & 0xFF != 0 || code >> 26 & 1 != 0 || code >> 12 & 7 == 0 || code >> 14 & 1 != 0
        }
        "1111001" if form.starts_with("11110011011") => low >= lsb,
        "1111001" if form.starts_with("1111001100i") || form.starts_with("1111001110i") => {
            code >> 21 & 1 == 0 || lsb != 0
        }
        "1111001" => lsb + low < 32,
        _ => !same('l', 'h'),
    }
}

/// A place with an instruction in it, within an IT block of one now and then.
fn drawn(rng: &mut Rng) -> ([u16; PLACE / 2], String) {
    let both = NARROW.len() + WIDE.len();
    loop {
        let number = below(rng, both as u32) as usize;
        let form = NARROW.iter().chain(&WIDE).nth(number).expect("among them");
        let (code, taken) = filled(rng, form);
        if !is_defined(form, code, &taken) {
            continue;
        }
        let it = 0xBF08 | (below(rng, 14) << 4) as u16;
        let code = match form.len() {
            16 => vec![code as u16],
            _ => vec![(code >> 16) as u16, code as u16],
        };
        let mut place = [WFI; PLACE / 2];
        let conditional = below(rng, 4) == 0;
        let from = usize::from(conditional);
        place[0] = if conditional { it } else { WFI };
        place[from..from + code.len()].copy_from_slice(&code);
        return (place, format!("{form} {place:04X?}"));
    }
}

fn cpu<C: Cpu>(code: &[u8]) -> C {
    let sensor = Rc::new(RefCell::new(lis2dw12::Chip::new(Traits::TYPICAL)));
    let individual = Individual {
        identity: [1, 2, 3],
        crystal: 1.0,
        lsi_hz: 40_000,
        seed: 1,
    };
    let mut cpu = C::new(Chip::new(RC, individual, sensor, 0));
    while cpu.chip_mut().can.take_action().is_some() {}
    cpu.chip_mut().flash.flash(0, code).expect("in flash");
    cpu.put_flash_right();
    cpu.chip_mut().set_limit_ns(u64::MAX / 4);
    let mut rng = Rng::stream(1, "ram");
    let ram: Vec<u8> = (0..RC.ram).map(|_| below(&mut rng, 256) as u8).collect();
    cpu.write(RAM, &ram).expect("in RAM");
    cpu
}

/// What a register holds before: an address in the RAM, a small number, or any.
fn operand(rng: &mut Rng) -> u32 {
    match below(rng, 4) {
        0 | 1 => RAM + 0x2000 + 4 * below(rng, 0x1000),
        2 => below(rng, 40),
        _ => word(rng),
    }
}

fn prepare(cpu: &mut impl Cpu, values: &[u32], flags: u32, at: u32) {
    for (number, value) in (0u8..13).zip(values) {
        cpu.set_register(Register::R(number), *value);
    }
    cpu.set_register(Register::Xpsr, flags & 0xF800_0000 | 1 << 24);
    cpu.set_register(Register::Sp, RAM + 0x4000);
    cpu.set_register(Register::Lr, RAM + 0x3000);
    cpu.set_register(Register::Pc, at | 1);
}

#[test]
fn drawn_instructions_do_the_same_on_two_cores() {
    let mut rng = Rng::stream(15, "instructions");
    let places: Vec<_> = (0..RC.flash as usize / PLACE)
        .map(|_| drawn(&mut rng))
        .collect();
    let half_words = places.iter().flat_map(|(place, _)| place);
    let code: Vec<u8> = half_words.flat_map(|word| word.to_le_bytes()).collect();
    let (mut own, mut other) = (cpu::<CortexM3>(&code), cpu::<UnicornCpu>(&code));
    let (mut stops, mut unaligned) = (0, 0);
    for (number, (_, name)) in places.iter().enumerate() {
        let values: Vec<u32> = (0..13).map(|_| operand(&mut rng)).collect();
        let (flags, at) = (word(&mut rng), BASE + (number * PLACE) as u32);
        prepare(&mut own, &values, flags, at);
        prepare(&mut other, &values, flags, at);
        let (stop, stop_too) = (own.run(), other.run());
        if stop == Stop::Fault(Fault::Unaligned) {
            // The engine carries it out where the part does not; see ARMv7-M A3.2.1.
            unaligned += 1;
            other = cpu::<UnicornCpu>(&code);
            own = cpu::<CortexM3>(&code);
            continue;
        }
        assert_eq!(stop, stop_too, "{name} with {values:X?}");
        let (mut found, found_too) = (registers(&own), registers(&other));
        if matches!(stop, Stop::Fault(_)) {
            // Where a fault is in an IT block, the engine does not tell.
            if found[XPSR] & IT_STATE != 0 {
                (found[PC], found[XPSR]) = (found_too[PC], found_too[XPSR]);
            }
            // What was begun is taken back by the part (ARMv7-M B1.5.6), not by the engine. The
            // registers of a list may hold anything then.
            if !name.starts_with("1110100") && !name.starts_with("1100") {
                assert_eq!(found[..13], values, "{name}");
            }
            found[..13].copy_from_slice(&found_too[..13]);
            stops += 1;
        }
        assert_eq!(
            found, found_too,
            "{name} with {values:X?}, flags {flags:08X}"
        );
    }
    let mut ram = [(); 2].map(|()| vec![0; RC.ram as usize]);
    own.read(RAM, &mut ram[0]).expect("the RAM is there");
    other.read(RAM, &mut ram[1]).expect("the RAM is there");
    assert!(ram[0] == ram[1], "the RAM differs");
    eprintln!(
        "{} instructions, {stops} faults, {unaligned} unaligned",
        places.len()
    );
    assert!(stops < places.len() / 5);
}
