//! Arbitrary bytes as messages from a host: accepted or rejected; whatever the host requests, the
//! watchdog keeps its safety promises, and its next deadline lies ahead.
#![no_main]

use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use spykee::behaviour::ToHost;
use spykee::robot::{BehaviourId, Intent, Priority};
use spykee::safety::{Act, Fact, Limits, Watchdog};
use spykee::script::FromHost;
use spykee::wire::{Command, EngineReport, Power};
use tokio::time::Instant;

const WHO: BehaviourId = BehaviourId(0);
/// Maximum power with which the watchdog moves a low robot between its searches.
const OWN_LEGS: i8 = 27;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(message) = postcard::from_bytes::<ToHost>(bytes) {
        let again = postcard::to_allocvec(&message).expect("a parsed message can be written");
        postcard::from_bytes::<ToHost>(&again).expect("a written message can be read");
    }
    let mut rig = Rig::new();
    let mut rest = bytes;
    while let Ok((message, tail)) = postcard::take_from_bytes::<FromHost>(rest) {
        if let FromHost::Intent(intent) = message {
            rig.ask(intent);
        }
        // A host's messages have length prefixes; here a byte between two messages selects another
        // event.
        let Some((&happens, tail)) = tail.split_first() else {
            break;
        };
        rig.happen(happens);
        rest = tail;
    }
});

struct Rig {
    dog: Watchdog,
    now: Instant,
}

impl Rig {
    fn new() -> Rig {
        let now = Instant::now();
        let mut dog = Watchdog::new(Limits::default(), now);
        let power = Power {
            percent: 80,
            charging: false,
        };
        let docked = false;
        dog.handle(Fact::LinkUp { docked, power }, now);
        Rig { dog, now }
    }

    fn ask(&mut self, intent: Intent) {
        let low = self.dog.low().is_some();
        self.dog.request(WHO, Priority(0), intent, self.now);
        let acts = self.dog.poll(self.now);
        self.check(&acts);
        let moves = |command: Command| matches!(command, Command::Move { left, right } if (left, right) != (0, 0));
        assert!(!low || !acts.iter().filter_map(Act::command).any(moves), "a script moves a low robot");
    }

    fn happen(&mut self, happens: u8) {
        let what = happens & 7;
let how = happens >> 3;
        match what {
            0 => drop(self.handle(Fact::Engine(EngineReport::from(how)))),
            1 | 2 => drop(self.handle(Fact::Power(Power {
                percent: how * 4,
                charging: what == 2,
            }))),
            3 => drop(self.handle(Fact::Alive(WHO))),
            _ => {
                self.now += Duration::from_millis(1 << how.min(20));
                let acts = self.dog.poll(self.now);
                self.check(&acts);
            }
        }
    }

    fn handle(&mut self, fact: Fact) -> Vec<Act> {
        let acts = self.dog.handle(fact, self.now);
        self.check(&acts);
        acts
    }

    fn check(&self, acts: &[Act]) {
        for command in acts.iter().filter_map(Act::command) {
            if let Command::Move { left, right } = command {
                let still = (left, right) == (0, 0);
                assert!(still || !self.dog.docked(), "it moves while docked");
                // Only the watchdog moves a low robot, slowly, between its searches.
                let most = if self.dog.low().is_some() { OWN_LEGS } else { 90 };
                assert!((-most..=most).contains(&left) && (-most..=most).contains(&right));
            }
        }
        assert!(self.dog.next_deadline().is_none_or(|due| due > self.now));
    }
}
