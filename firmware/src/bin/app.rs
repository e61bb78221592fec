//! The application: interrupts bring events, one task runs the device, and the rest of the time is
//! for checking the program and for sleep.
//!
//! | priority | runs | does |
//! |---|---|---|
//! | 2 | TIM2, the four of CAN | leave in the inbox what has happened, with its time |
//! | 1 | `serve` (TIM3's vector, pended by the others) | hands it to the device |
//! | 0 | `idle` | the program's check sum (R9), the watchdog, `wfi` |
//!
//! The task has a hardware vector of its own that no timer uses: a software task of RTIC would
//! bring an executor for futures along, and nothing here waits for one.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[rtic::app(device = stm32f1xx_hal::pac, peripherals = true)]
mod app {
    use core::mem::MaybeUninit;

    use firmware::chip::{board, can, clock};
    use firmware::inbox::Inbox;
    use firmware::node::Node;
    use firmware::self_check::{SelfCheck, running_slot};
    use stm32f1xx_hal::pac::Interrupt;

    #[shared]
    struct Shared {
        inbox: Inbox,
    }

    #[local]
    struct Local {
        node: &'static mut Node,
        check: SelfCheck,
    }

    #[init(local = [place: MaybeUninit<Node> = MaybeUninit::uninit()])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let board = board::start(cx.device, running_slot());
        let node = cx.local.place.write(Node::new(board));
        rtic::pend(Interrupt::TIM3);
        let inbox = Inbox::new();
        let check = SelfCheck::new();
        (Shared { inbox }, Local { node, check })
    }

    #[idle(local = [check])]
    fn idle(cx: idle::Context) -> ! {
        loop {
            cx.local.check.step();
            cortex_m::asm::wfi();
        }
    }

    #[task(binds = TIM3, priority = 1, local = [node], shared = [inbox])]
    fn serve(mut cx: serve::Context) {
        cx.local.node.serve(&mut cx.shared.inbox);
    }

    #[task(binds = TIM2, priority = 2, shared = [inbox])]
    fn timer(mut cx: timer::Context) {
        if let Some(edge) = clock::interrupt() {
            cx.shared.inbox.lock(|inbox| inbox.edge(edge));
        }
        rtic::pend(Interrupt::TIM3);
    }

    #[task(binds = USB_HP_CAN_TX, priority = 2, shared = [inbox])]
    fn can_sent(mut cx: can_sent::Context) {
        let now = clock::now();
        cx.shared.inbox.lock(|inbox| can::interrupt(inbox, now));
        rtic::pend(Interrupt::TIM3);
    }

    #[task(binds = USB_LP_CAN_RX0, priority = 2, shared = [inbox])]
    fn can_received(mut cx: can_received::Context) {
        let now = clock::now();
        cx.shared.inbox.lock(|inbox| can::interrupt(inbox, now));
        rtic::pend(Interrupt::TIM3);
    }

    #[task(binds = CAN_SCE, priority = 2, shared = [inbox])]
    fn can_state(mut cx: can_state::Context) {
        let now = clock::now();
        cx.shared.inbox.lock(|inbox| can::interrupt(inbox, now));
        rtic::pend(Interrupt::TIM3);
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask image`; nothing to run");
}
