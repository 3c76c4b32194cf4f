//! Any bytes as what a host says: understood or refused; and whatever the host asks for, the watchdog
//! keeps its promises and its clock.
#![no_main]

use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use spykee::behaviour::{FromHost, ToHost};
use spykee::robot::{BehaviourId, Intent, Priority};
use spykee::safety::{Act, Fact, Limits, Watchdog};
use spykee::script::Output;
use spykee::wire::{Command, EngineReport, Power};
use tokio::time::Instant;

const WHO: BehaviourId = BehaviourId(0);
/// The most power with which the watchdog moves a low robot between its searches.
const OWN_LEGS: i8 = 27;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(message) = postcard::from_bytes::<ToHost>(bytes) {
        let again = postcard::to_allocvec(&message).expect("it was read");
        postcard::from_bytes::<ToHost>(&again).expect("it was written");
    }
    let mut rig = Rig::new();
    let mut rest = bytes;
    while let Ok((message, tail)) = postcard::take_from_bytes::<FromHost>(rest) {
        if let FromHost::Output(Output::Intent(intent)) = message {
            rig.ask(intent);
        }
        // A host's messages have lengths in front; here a byte between two says what else happens.
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
        dog.take(Fact::LinkUp { docked, power }, now);
        Rig { dog, now }
    }

    fn ask(&mut self, intent: Intent) {
        let low = self.dog.low().is_some();
        let acts = self.take(Fact::Asked {
            by: WHO,
            priority: Priority(0),
            intent,
        });
        let moves = |command: Command| matches!(command, Command::Move { left, right } if (left, right) != (0, 0));
        assert!(!low || !acts.iter().filter_map(Act::command).any(moves), "a script moves a low robot");
    }

    fn happen(&mut self, happens: u8) {
        let (what, how) = (happens & 7, happens >> 3);
        match what {
            0 => drop(self.take(Fact::Engine(EngineReport::from(how)))),
            1 | 2 => drop(self.take(Fact::Power(Power {
                percent: how * 4,
                charging: what == 2,
            }))),
            3 => drop(self.take(Fact::Alive(WHO))),
            _ => {
                self.now += Duration::from_millis(1 << how.min(20));
                let acts = self.dog.tick(self.now);
                self.check(&acts);
            }
        }
    }

    fn take(&mut self, fact: Fact) -> Vec<Act> {
        let acts = self.dog.take(fact, self.now);
        self.check(&acts);
        acts
    }

    fn check(&self, acts: &[Act]) {
        for command in acts.iter().filter_map(Act::command) {
            if let Command::Move { left, right } = command {
                let still = (left, right) == (0, 0);
                assert!(still || !self.dog.docked(), "it moves off its station");
                // A low robot is moved between its searches, by the watchdog itself and slowly.
                let most = if self.dog.low().is_some() { OWN_LEGS } else { 90 };
                assert!((-most..=most).contains(&left) && (-most..=most).contains(&right));
            }
        }
        assert!(self.dog.next_deadline().is_none_or(|due| due > self.now));
    }
}
