use std::time::Duration;

use bytes::Bytes;
use tokio::time::timeout;

use super::*;
use crate::behaviour::Library;
use crate::robot::Frame;
use crate::script::Options;

const JPEG: &[u8] = include_bytes!("../../../tests/fixtures/ball-422.jpg");

/// Starts a host for a script; returns the agent's ends of its pipe.
async fn host_of(source: &str) -> (Sender<ToHost>, Receiver<FromHost>) {
    host_in(Time::Virtual, source).await
}

async fn host_in(time: Time, source: &str) -> (Sender<ToHost>, Receiver<FromHost>) {
    let (near, far) = tokio::io::duplex(1 << 20);
    let (reader, writer) = tokio::io::split(far);
    tokio::task::spawn_local(serve(reader, writer, time));
    let (reader, writer) = tokio::io::split(near);
    let mut to = Sender::new(writer);
    let from = Receiver::new(reader);
    let launch = Launch {
        source: source.into(),
        options: Options::new("test", "test.lua"),
        library: Library::default(),
    };
    to.send(&ToHost::Load(Box::new(launch))).await.unwrap();
    to.send(&ToHost::Run).await.unwrap();
    (to, from)
}

fn frame(seq: u64) -> ToHost {
    let at = Instant::now();
    let jpeg = Bytes::from_static(JPEG);
    ToHost::Frame(Frame { seq, at, jpeg })
}

/// Waits for the next frame request. Returns whether it asks for partial frames, and the lines the
/// script logged before it.
async fn next_request(from: &mut Receiver<FromHost>) -> (bool, Vec<String>) {
    let mut lines = Vec::new();
    loop {
        let message = timeout(Duration::from_secs(60), from.next()).await.unwrap();
        match message.unwrap().unwrap() {
            FromHost::Output(Output::Log(line)) => lines.push(line.text),
            FromHost::WantFrame { partial, .. } => return (partial, lines),
            _ => {}
        }
    }
}

#[tokio::test(flavor = "local")]
async fn a_script_sees_the_same_frame_however_it_is_split_into_parts() {
    let look = "robot.on('frame', function(f) print(f:find_blobs('red')[1].pixels) end)";
    let (mut to, mut from) = host_of(look).await;
    assert!(!next_request(&mut from).await.0);
    to.send(&frame(1)).await.unwrap();
    let (partial, seen) = next_request(&mut from).await;
    assert!(partial && seen.len() == 1, "{partial} {seen:?}");
    for (number, cuts) in [[700, 1500], [100, JPEG.len() - 1], [0, 0]]
        .iter()
        .enumerate()
    {
        let mut at = 0;
        for &cut in cuts {
            let jpeg = Bytes::from_static(&JPEG[at..cut]);
            to.send(&ToHost::PartialFrame { at, jpeg }).await.unwrap();
            at = cut;
        }
        to.send(&frame(number as u64 + 2)).await.unwrap();
        assert_eq!(next_request(&mut from).await, (true, seen.clone()));
    }
    // A part in the middle was lost.
    let jpeg = Bytes::from_static(&JPEG[900..]);
    to.send(&ToHost::PartialFrame { at: 900, jpeg })
        .await
        .unwrap();
    to.send(&frame(9)).await.unwrap();
    assert_eq!(next_request(&mut from).await, (true, seen));
}

#[tokio::test(flavor = "local")]
async fn partial_frames_are_not_requested_for_a_script_without_vision() {
    let (mut to, mut from) = host_of("robot.on('frame', function(f) print(f.seq) end)").await;
    next_request(&mut from).await;
    to.send(&frame(1)).await.unwrap();
    assert_eq!(next_request(&mut from).await, (false, vec!["1".to_owned()]));
}
