//! The shell of every application: interrupts bring events, one task runs the device, and the rest
//! of the time is for checking the program and for sleep.
//!
//! In: an [`Image`](crate::image::Image). Out: by
//! [`application`](crate::application) the RTIC application around it, which has to be in the
//! binary itself.
//!
//! | priority | runs | does |
//! |---|---|---|
//! | 2 | TIM2, the four of CAN | leave in the inbox what has happened, with its time |
//! | 1 | `serve` (TIM3's vector, pended by the others) | hands it to the device |
//! | 0 | `idle` | the program's check sum (R9), the watchdog, `wfi` |
//!
//! The task has a hardware vector of its own that no timer uses: a software task of RTIC would
//! bring an executor for futures along, and nothing here waits for one.

/// The application of the named image; once in a binary, at its root.
#[macro_export]
macro_rules! application {
    ($image:ty) => {
        #[rtic::app(device = stm32f1xx_hal::pac, peripherals = true)]
        mod app {
            use cortex_m::peripheral::SCB;
            use stm32f1xx_hal::pac::Interrupt;
            use $crate::board_node::BoardNode;
            use $crate::chip::board::{self, Board};
            use $crate::chip::nor::Erase;
            use $crate::chip::{can, clock};
            use $crate::image::Image;
            use $crate::inbox::Inbox;
            use $crate::self_check::{SelfCheck, running_slot};

            type Chosen = $image;

            #[shared]
            struct Shared {
                inbox: Inbox,
                node: Option<&'static mut BoardNode<Chosen>>,
            }

            #[local]
            struct Local {
                board: Option<Board<<Chosen as Image>::Eraser>>,
                check: SelfCheck,
            }

            #[init]
            fn init(cx: init::Context) -> (Shared, Local) {
                let layout = <Chosen as Image>::Eraser::LAYOUT;
                let running = layout.slot(running_slot(layout));
                let board = Some(board::start(cx.device, running));
                let (inbox, node) = (Inbox::new(), None);
                let check = SelfCheck::new(layout);
                (Shared { inbox, node }, Local { board, check })
            }

            /// The device is on the stack of this function, under everything else: a static would
            /// have to be filled from a copy on the stack, and so take the RAM twice.
            #[idle(local = [board, check], shared = [node])]
            fn idle(mut cx: idle::Context) -> ! {
                // It is there: this is the only one to take it, and does so once.
                let Some(board) = cx.local.board.take() else {
                    SCB::sys_reset()
                };
                let mut node = BoardNode::new(board);
                // SAFETY: this function never ends, so `node` stays where it is, and it is not used
                // here under its own name any more.
                let node = unsafe { &mut *(&raw mut node) };
                cx.shared.node.lock(|place| *place = Some(node));
                rtic::pend(Interrupt::TIM3);
                loop {
                    cx.local.check.step();
                    Chosen::background();
                    cortex_m::asm::wfi();
                }
            }

            #[task(binds = TIM3, priority = 1, shared = [inbox, node])]
            fn serve(mut cx: serve::Context) {
                let inbox = &mut cx.shared.inbox;
                cx.shared.node.lock(|node| {
                    // An interrupt may come before the device is there.
                    if let Some(node) = node {
                        node.serve(inbox);
                    }
                });
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

            #[task(binds = CAN_RX1, priority = 2, shared = [inbox])]
            fn can_asked(mut cx: can_asked::Context) {
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
    };
}
