//! A chip that runs: the core, its exceptions, its sleep and its resets.
//!
//! In: a flash with an image, and the time up to which to go. Out: why it has stopped there.
//!
//! Sources: PM0056 2.3 (exceptions), 2.4 (faults), 2.5 (sleep). Left out: the time that entering
//! and leaving an exception takes: it counts as no instruction.

use std::collections::BTreeMap;

use flash::layout::RAM;

use crate::chip::Chip;
use crate::chip::nvic::{HARD_FAULT, SV_CALL, Waiting};
use crate::chip::rcc::Cause;
use crate::chip::system::Blame;
use crate::cortex_m3::CortexM3;
use crate::cpu::{ALIAS, Cpu, Fault, Register, Stop};
use crate::exceptions::{self, Masks};

/// Why a machine has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// It has come to the time up to which it was to go, or beyond it.
    AtLimit,
    /// It wants something of the bus.
    Acts,
    /// The supply has failed in a flash operation.
    Cut,
}

/// What the RAM still holds when power comes back; the data sheet promises nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// Anything.
    Nothing,
    /// What it held, but for a bit in each 64th byte or so.
    Most,
    /// What it held.
    All,
}

/// Why the core does not execute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pause {
    /// It does.
    None,
    /// WFI.
    Interrupt,
    /// WFE.
    Event,
    /// A fault within the handling of one (PM0056 2.4.4); until a reset.
    LockUp,
}

/// What the handlers of one exception have taken so far, without those that interrupted them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// How often it was served.
    pub times: u64,
    /// Instructions in all.
    pub instructions: u64,
    /// Instructions of the longest one.
    pub most: u64,
}

/// A handler under way.
#[derive(Clone, Copy, Debug)]
struct Service {
    number: u32,
    /// The chip's count at its begin.
    begun: u64,
    /// What others took of it that have interrupted it.
    nested: u64,
}

/// A core with its chip.
#[derive(Debug)]
pub struct Machine<C = CortexM3> {
    cpu: C,
    pause: Pause,
    resets: Vec<Cause>,
    faults: Vec<(u32, Blame)>,
    services: Vec<Service>,
    costs: BTreeMap<u32, Cost>,
}

impl<C: Cpu> Machine<C> {
    /// A chip without power.
    pub fn new(chip: Chip) -> Self {
        Self {
            cpu: C::new(chip),
            pause: Pause::None,
            resets: Vec::new(),
            faults: Vec::new(),
            services: Vec::new(),
            costs: BTreeMap::new(),
        }
    }

    /// The core.
    pub fn cpu(&self) -> &C {
        &self.cpu
    }

    /// The core, to change.
    pub fn cpu_mut(&mut self) -> &mut C {
        &mut self.cpu
    }

    /// The chip.
    pub fn chip(&self) -> &Chip {
        self.cpu.chip()
    }

    /// The chip, to change.
    pub fn chip_mut(&mut self) -> &mut Chip {
        self.cpu.chip_mut()
    }

    /// Resets so far, with their causes.
    pub fn resets(&self) -> &[Cause] {
        &self.resets
    }

    /// Faults so far: where, and what.
    pub fn faults(&self) -> &[(u32, Blame)] {
        &self.faults
    }

    /// What each exception's handlers have taken since [`Machine::clear_costs`], by its number:
    /// interrupt n is exception 16 + n.
    pub fn costs(&self) -> &BTreeMap<u32, Cost> {
        &self.costs
    }

    /// Lets [`Machine::costs`] begin anew.
    pub fn clear_costs(&mut self) {
        self.costs.clear();
    }

    /// True when it has locked up and only a reset helps.
    pub fn is_locked_up(&self) -> bool {
        self.pause == Pause::LockUp
    }

    /// True while the core sleeps.
    pub fn sleeps(&self) -> bool {
        self.pause != Pause::None
    }

    /// Power comes, and the RAM holds so much of what it held.
    pub fn power_on(&mut self, kept: Kept) {
        let mut bytes = vec![0; self.chip().ram_size() as usize];
        // The RAM is mapped whole.
        let _ = self.cpu.read(RAM, &mut bytes);
        let mut noise = self.chip().cycles() as u32 ^ 0x5DEE_CE66;
        for byte in &mut bytes {
            noise ^= noise << 13;
            noise ^= noise >> 17;
            noise ^= noise << 5;
            match kept {
                Kept::All => {}
                Kept::Most if noise >> 26 != 0 => {}
                Kept::Most => *byte ^= 1 << (noise & 7),
                Kept::Nothing => *byte = noise as u8,
            }
        }
        let _ = self.cpu.write(RAM, &bytes);
        self.reset(Cause::Power);
    }

    /// Starts anew (PM0056 2.3.2: stack pointer and program counter from the vectors).
    pub fn reset(&mut self, cause: Cause) {
        self.resets.push(cause);
        self.pause = Pause::None;
        self.services.clear();
        self.chip_mut().restart(cause);
        self.cpu.put_flash_right();
        let [stack, start] = [0, 4].map(|offset| self.word(ALIAS + offset));
        for mask in [Register::Primask, Register::Basepri, Register::Faultmask] {
            self.cpu.set_register(mask, 0);
        }
        self.cpu.set_register(Register::Xpsr, 1 << 24);
        self.cpu.set_register(Register::Control, 0);
        self.cpu.set_register(Register::Lr, u32::MAX);
        self.cpu.set_register(Register::Sp, stack & !3);
        self.cpu.set_register(Register::Pc, start);
    }

    /// Goes on in the program whose vector table is at `vectors`, as after a jump of the bootloader
    /// or of a debugger.
    pub fn jump(&mut self, vectors: u32) {
        let [stack, start] = [0, 4].map(|offset| self.word(vectors + offset));
        self.chip_mut().system.set_vectors(vectors);
        self.cpu.set_register(Register::Sp, stack & !3);
        self.cpu.set_register(Register::Pc, start);
    }

    /// Ends the core's sleep from outside, after its registers were changed.
    pub fn wake(&mut self) {
        self.pause = Pause::None;
    }

    /// Lets a core that sleeps come to `now_ns`.
    pub fn sleep_until(&mut self, now_ns: u64) {
        if self.sleeps() {
            self.chip_mut().skip_to(now_ns);
        }
    }

    /// Its own time, or when it next does anything while it sleeps, ns.
    pub fn next_ns(&mut self) -> u64 {
        self.chip_mut().attend();
        let chip = self.chip();
        let waiting = match self.pause {
            Pause::None => true,
            _ if chip.can.has_actions() || chip.wanted_reset().is_some() => true,
            Pause::LockUp => false,
            Pause::Event if chip.has_event() => true,
            Pause::Event | Pause::Interrupt => {
                let masks = Masks::of(&self.cpu);
                let first = chip.nvic.first();
                first.is_some_and(|first| masks.wakes(first, &chip.nvic))
            }
        };
        match waiting {
            true => chip.now_ns(),
            false => self.chip_mut().wakes_ns(),
        }
    }

    /// A word of flash or RAM; 0 where neither is.
    pub fn word(&self, address: u32) -> u32 {
        let mut bytes = [0; 4];
        match self.cpu.read(address, &mut bytes) {
            Ok(()) => u32::from_le_bytes(bytes),
            Err(_) => 0,
        }
    }

    /// Runs until `until_ns` of the world, or until something is wanted of the world.
    pub fn run(&mut self, until_ns: u64) -> Ended {
        self.chip_mut().set_limit_ns(until_ns);
        loop {
            if let Some(ended) = self.ended() {
                return ended;
            }
            if let Some(cause) = self.chip().wanted_reset() {
                self.reset(cause);
                self.chip_mut().set_limit_ns(until_ns);
                continue;
            }
            if self.pause == Pause::LockUp {
                self.chip_mut().sleep();
                continue;
            }
            if self.chip_mut().take_bad_store() {
                self.fault(Blame::LateStore);
                continue;
            }
            self.chip_mut().attend();
            if !self.take_exception() {
                self.go_on();
            }
        }
    }

    fn ended(&self) -> Option<Ended> {
        let chip = self.chip();
        if chip.is_cut() {
            return Some(Ended::Cut);
        }
        if chip.can.has_actions() {
            return Some(Ended::Acts);
        }
        chip.is_at_limit().then_some(Ended::AtLimit)
    }

    /// Takes the exception that waits, if the masks let it; true when it was taken.
    fn take_exception(&mut self) -> bool {
        let Some(waiting) = self.chip().nvic.first() else {
            return false;
        };
        let masks = Masks::of(&self.cpu);
        let nvic = &self.chip().nvic;
        if masks.let_through(waiting, nvic) {
            self.enter(waiting);
            return true;
        }
        if self.pause == Pause::Interrupt && masks.wakes(waiting, nvic) {
            self.pause = Pause::None;
        }
        false
    }

    /// Executes, or lets the time of its sleep pass.
    fn go_on(&mut self) {
        let chip = self.cpu.chip_mut();
        let pending = chip.system.pending_is_event() && chip.nvic.first().is_some();
        if self.pause == Pause::Event && (pending || chip.take_event()) {
            self.pause = Pause::None;
        }
        if self.pause != Pause::None {
            chip.sleep();
            return;
        }
        match self.cpu.run() {
            Stop::Wanted => {}
            Stop::WaitForInterrupt => self.pause = Pause::Interrupt,
            Stop::WaitForEvent => self.pause = Pause::Event,
            Stop::SupervisorCall => self.call_supervisor(),
            Stop::ExceptionReturn(link) => self.leave(link),
            Stop::Fault(fault) => self.fault(match fault {
                Fault::Bus { address } => Blame::Data(address),
                Fault::Fetch { .. } => Blame::Instruction,
                Fault::Undefined => Blame::Undefined,
                Fault::Unaligned => Blame::Unaligned,
                Fault::Breakpoint => Blame::Breakpoint,
            }),
        }
    }

    fn enter(&mut self, waiting: Waiting) {
        let vectors = self.chip().system.vectors();
        let entered = exceptions::enter(&mut self.cpu, waiting.number, vectors);
        let chip = self.cpu.chip_mut();
        chip.nvic.begin(waiting.number);
        chip.set_event();
        let begun = chip.instructions();
        self.services.push(Service {
            number: waiting.number,
            begun,
            nested: 0,
        });
        self.pause = Pause::None;
        if entered.is_err() {
            self.faults
                .push((self.cpu.register(Register::Pc), Blame::Stacking));
            self.pause = Pause::LockUp;
        }
    }

    fn leave(&mut self, link: u32) {
        let Ok(number) = exceptions::leave(&mut self.cpu, link) else {
            return self.fault(Blame::Stacking);
        };
        self.account(number);
        let chip = self.cpu.chip_mut();
        chip.nvic.end(number);
        chip.set_event();
        if chip.system.sleeps_on_exit() && chip.nvic.depth() == 0 {
            self.pause = Pause::Interrupt;
        }
    }

    /// Notes what a handler that has ended has taken.
    fn account(&mut self, number: u32) {
        let now = self.chip().instructions();
        let Some(service) = self
            .services
            .pop()
            .filter(|service| service.number == number)
        else {
            return;
        };
        let whole = now - service.begun;
        let own = whole.saturating_sub(service.nested);
        let cost = self.costs.entry(number).or_default();
        cost.times += 1;
        cost.instructions += own;
        cost.most = cost.most.max(own);
        if let Some(outer) = self.services.last_mut() {
            outer.nested += whole;
        }
    }

    fn call_supervisor(&mut self) {
        self.chip_mut().nvic.pend(SV_CALL);
        if !self.take_exception() {
            self.chip_mut().nvic.unpend(SV_CALL);
            self.fault(Blame::Undefined);
        }
    }

    /// A fault: its own exception, a hard fault, or the end (PM0056 2.4.2).
    fn fault(&mut self, blame: Blame) {
        self.faults.push((self.cpu.register(Register::Pc), blame));
        let chip = self.cpu.chip_mut();
        let number = chip.system.blame(blame);
        if chip.nvic.current() < 0 {
            self.pause = Pause::LockUp;
            return;
        }
        chip.nvic.pend(number);
        if !self.take_exception() {
            let chip = self.cpu.chip_mut();
            chip.nvic.unpend(number);
            chip.system.escalate();
            chip.nvic.pend(HARD_FAULT);
            if !self.take_exception() {
                self.pause = Pause::LockUp;
            }
        }
    }
}

impl<C: Cpu> Machine<C> {
    /// Bytes from `from` on that still hold the paint: of a stack whose end that is, those that
    /// were never used.
    pub fn painted_from(&self, from: u32, paint: u32) -> u32 {
        let end = RAM + self.chip().ram_size();
        let words = (from..end).step_by(4);
        4 * words.take_while(|at| self.word(*at) == paint).count() as u32
    }
}
