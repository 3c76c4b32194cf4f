use proptest::prelude::*;

use super::*;
use crate::wire::{Decoder, Engage, Led};

const GO: Command = Command::Move {
    left: 50,
    right: 50,
};
const GO_BYTES: [u8; 7] = [0x50, 0x4B, 0x05, 0x00, 0x02, 0x32, 0x32];
const STOP_BYTES: [u8; 7] = [0x50, 0x4B, 0x05, 0x00, 0x02, 0x00, 0x00];
const DOCK: Command = Command::Engine(Engage::Dock);
const MS: Duration = Duration::from_millis(1);

fn samples(length: usize) -> Bytes {
    Bytes::from(vec![7; length])
}

/// A queue with the test's own clock and transport.
struct Rig {
    queue: SendQueue,
    now: Instant,
    out: Vec<u8>,
}

impl Rig {
    fn new() -> Rig {
        Rig {
            queue: SendQueue::default(),
            now: Instant::now(),
            out: Vec::new(),
        }
    }

    fn push(&mut self, commands: &[Command]) -> bool {
        self.queue.push(commands, self.now)
    }

    /// Writes at most `room` bytes of the offer; returns how many.
    fn write(&mut self, room: usize) -> usize {
        let offer = self.queue.offer(self.now, || Some(0));
        let count = offer.len().min(room);
        self.out.extend_from_slice(&offer[..count]);
        self.queue.advance(count, self.now);
        count
    }

    /// Writes everything on offer without time passing.
    fn drain(&mut self) {
        while self.write(usize::MAX) > 0 {}
    }

    /// The commands written so far.
    fn written(&self) -> Vec<Command> {
        let mut decoder = Decoder::new();
        let mut input = &self.out[..];
        let mut written = Vec::new();
        while let Some(packet) = decoder.decode(&mut input).unwrap() {
            written.push(Command::parse(packet));
        }
        assert_eq!(decoder.buffered(), 0, "a message is cut");
        written
    }
}

proptest! {
    #[test]
    fn a_partly_written_message_is_finished_and_later_motion_dropped(cut in 0usize..21) {
        let mut rig = Rig::new();
        prop_assert!(rig.push(&[GO, GO, GO]));
        rig.write(cut);
        rig.queue.replace_unstarted(&[Command::STOP], rig.now);
        rig.drain();
        let (messages, last) = rig.out.split_at(rig.out.len() - 7);
        prop_assert_eq!(messages, GO_BYTES.repeat(cut.div_ceil(7)));
        prop_assert_eq!(last, STOP_BYTES);
    }
}

#[test]
fn written_messages_are_forgotten() {
    let mut rig = Rig::new();
    rig.push(&[GO]);
    rig.drain();
    assert!(rig.queue.is_empty());
    rig.queue.replace_unstarted(&[Command::STOP], rig.now);
    rig.drain();
    assert_eq!(rig.written(), [GO, Command::STOP]);
}

#[test]
fn the_queue_is_bounded() {
    let mut rig = Rig::new();
    let light = Command::Led {
        led: Led::Left,
        on: true,
    };
    let pushes = (0..1_000_000).take_while(|_| rig.push(std::slice::from_ref(&light)));
    // Commands of 7 bytes, until more than 64 KiB are queued.
    assert_eq!(pushes.count(), 64 * 1024 / 7 + 1);
    assert!(!rig.queue.say(&samples(128_002)) && rig.queue.say(&samples(128_000)));
    assert!(!rig.queue.say(&samples(2)));
    rig.queue.drop_audio();
    assert!(rig.queue.say(&samples(128_000)));
}

#[test]
fn commands_are_accepted_until_the_bound_is_exceeded() {
    let mut rig = Rig::new();
    let light = Command::Led {
        led: Led::Left,
        on: true,
    };
    let fits = [vec![light.clone(); 9358], vec![Command::Volume(1); 5]].concat();
    assert!(rig.push(&fits));
    assert_eq!(rig.queue.waiting, MAX_WAITING);
    assert!(rig.push(std::slice::from_ref(&light)));
    assert!(!rig.push(&[light]));
}

#[test]
fn the_data_for_another_process_begins_with_the_rest_of_a_partly_written_message() {
    let mut rig = Rig::new();
    rig.push(&[GO]);
    rig.write(3);
    rig.push(&[DOCK]);
    let (rest, whole) = rig.queue.after_replacing(&[Command::STOP]);
    assert_eq!((rest, &whole[..]), (&GO_BYTES[3..], &STOP_BYTES[..]));
    let (rest, whole) = rig.queue.after_replacing(&[]);
    assert_eq!((rest, &whole[..]), (&GO_BYTES[3..], &DOCK.to_bytes()[..]));
}

#[test]
fn samples_among_commands_are_speech() {
    let mut rig = Rig::new();
    rig.push(&[Command::Audio(samples(100))]);
    assert!(rig.queue.no_command_pending() && !rig.queue.is_empty());
    rig.queue.drop_audio();
    assert!(rig.queue.is_empty());
    rig.push(&[GO]);
    assert!(!rig.queue.no_command_pending());
}

#[test]
fn a_newer_move_replaces_the_queued_ones() {
    let mut rig = Rig::new();
    rig.push(&[GO]);
    rig.push(&[GO]);
    rig.push(&[Command::STOP]);
    rig.drain();
    assert_eq!(rig.written(), [Command::STOP]);
}

#[test]
fn a_newer_move_overtakes_nothing_and_leaves_a_search_its_stop() {
    let mut rig = Rig::new();
    rig.push(&[GO]);
    rig.push(&[Command::STOP, DOCK]);
    rig.push(&[Command::Volume(3)]);
    rig.push(&[GO]);
    rig.push(&[Command::Engine(Engage::CancelDock), Command::STOP]);
    rig.push(&[GO]);
    rig.drain();
    let cancel = Command::Engine(Engage::CancelDock);
    let expected = [Command::STOP, DOCK, Command::Volume(3), GO, cancel, GO];
    assert_eq!(rig.written(), expected);
}

#[test]
fn a_replacing_move_inherits_the_waiting_time() {
    let mut rig = Rig::new();
    let began = rig.now;
    for _ in 0..10 {
        rig.push(&[GO]);
        rig.now += 500 * MS;
    }
    assert_eq!(rig.queue.waits_since(), Some(began));
    rig.drain();
    assert_eq!(rig.queue.waits_since(), None);
}

#[test]
fn commands_go_before_speech_that_is_not_begun() {
    let mut rig = Rig::new();
    rig.queue.say(&samples(4096));
    rig.write(100);
    rig.push(&[Command::STOP, DOCK]);
    rig.drain();
    let written = rig.written();
    assert_eq!(
        written[..3],
        [Command::Audio(samples(1024)), Command::STOP, DOCK]
    );
    assert_eq!(written[3..], vec![Command::Audio(samples(1024)); 3]);
}

#[test]
fn speech_waits_for_acknowledgements_and_a_stalled_link_is_detected() {
    let mut rig = Rig::new();
    rig.queue.say(&samples(1024));
    assert!(rig.queue.offer(rig.now, || Some(4097)).is_empty());
    assert_eq!(rig.queue.waits_since(), Some(rig.now));
    assert_eq!(rig.queue.next_offer(rig.now), Some(rig.now + RECHECK));
    assert_eq!(rig.queue.offer(rig.now, || Some(4096)).len(), 1029);
    assert_eq!(rig.queue.offer(rig.now, || None).len(), 1029);
}

#[test]
fn without_last_words_a_queued_search_is_still_sent() {
    let mut rig = Rig::new();
    rig.push(&[GO]);
    rig.push(&[Command::STOP, DOCK]);
    rig.push(&[GO]);
    rig.queue.replace_unstarted(&[], rig.now);
    rig.drain();
    assert_eq!(rig.written(), [Command::STOP, DOCK]);
}

#[test]
fn speech_is_sent_at_its_own_speed_with_a_small_lead() {
    let mut rig = Rig::new();
    let began = rig.now;
    for _ in 0..60 {
        assert!(rig.queue.say(&samples(32_000)));
        let next = rig.now + 1000 * MS;
        while let Some(look) = rig.queue.next_offer(rig.now).filter(|look| *look < next) {
            rig.drain();
            let passed = (rig.now - began).as_secs_f64();
            let most = 32_000.0 * (passed + 0.2) + 1030.0;
            assert!(
                rig.out.len() as f64 <= most,
                "{} after {passed} s",
                rig.out.len()
            );
            rig.now = look;
        }
        rig.drain();
        rig.now = next;
    }
    let wanted = 60.0 * 32_000.0 - 1029.0;
    assert!(rig.out.len() as f64 >= wanted, "{}", rig.out.len());
}

/// A step that changes the queue.
#[derive(Debug, Clone)]
enum Step {
    Push(Vec<Command>),
    Say(usize),
    Write(usize),
    Pass(u64),
    DropAudio,
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        (-90i8..=90).prop_map(|power| Command::Move {
            left: power,
            right: power
        }),
        Just(Command::STOP),
        Just(DOCK),
        Just(Command::Engine(Engage::CancelDock)),
        (0u8..=100).prop_map(Command::Volume),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => prop::collection::vec(command(), 0..4).prop_map(Step::Push),
        2 => (0usize..40_000).prop_map(Step::Say),
        4 => (0usize..1500).prop_map(Step::Write),
        1 => (0u64..300).prop_map(Step::Pass),
        1 => Just(Step::DropAudio),
    ]
}

/// The last command that decides on the tracks: a MOVE or ENGINE.
fn last_of(commands: &[Command]) -> Option<&Command> {
    let fate = |command: &&Command| matches!(command, Command::Move { .. } | Command::Engine(_));
    commands.iter().rev().find(fate)
}

proptest! {
    #[test]
    fn no_sequence_cuts_a_message_or_sends_speech_before_a_command(
        steps in prop::collection::vec(step(), 1..80),
    ) {
        let mut rig = Rig::new();
        let mut pushed = Vec::new();
let mut accepted = 0;
        for step in steps {
            match step {
                Step::Push(commands) => {
                    let before = rig.out.len();
                    let partly_written = rig.queue.partly_written.len();
                    prop_assert!(partly_written <= 1029);
                    prop_assert!(rig.push(&commands));
                    // If it were written now, nothing but the rest of that message would precede
                    // it.
                    let offer = rig.queue.offer(rig.now, || Some(0));
                    if rig.queue.waiting > 0 {
                        prop_assert_eq!(offer.len(), partly_written + rig.queue.waiting);
                    }
                    prop_assert_eq!(before, rig.out.len());
                    pushed.extend(commands);
                }
                Step::Say(length) => {
                    accepted += usize::from(rig.queue.say(&samples(length))) * length;
                }
                Step::Write(room) => {
                    rig.write(room);
                }
                Step::Pass(ms) => rig.now += ms as u32 * MS,
                Step::DropAudio => rig.queue.drop_audio(),
            }
            prop_assert!(rig.queue.waiting <= MAX_WAITING + 100);
        }
        rig.now += Duration::from_secs(60);
        while !rig.queue.is_empty() {
            rig.write(usize::MAX);
            rig.now += 50 * MS;
        }
        let written = rig.written();
        let spoken: usize = written
            .iter()
            .map(|command| if let Command::Audio(samples) = command { samples.len() } else { 0 })
            .sum();
        prop_assert!(spoken <= accepted);
        prop_assert_eq!(last_of(&written), last_of(&pushed));
        let engines = |commands: &[Command]| {
            commands.iter().filter(|command| matches!(command, Command::Engine(_))).cloned().collect::<Vec<_>>()
        };
        prop_assert_eq!(engines(&written), engines(&pushed), "none is lost, none overtakes another");
    }
}
