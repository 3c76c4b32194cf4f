//! The simulated robot answers, times and splits its messages as genuine ones do: clients that
//! speak to real robots rely on these facts.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use spykee::sim::{Options, Server};
use tokio::io::{AsyncRead, AsyncWrite, DuplexStream, ReadBuf};
use tokio::net::UdpSocket;
use tokio::time::timeout;

use super::camera_truth::{Statistics, frames_in, simulated};
use super::sim::*;

/// A pipe that records each write of the robot separately.
struct RecordingPipe {
    pipe: DuplexStream,
    writes: Arc<Mutex<Vec<Vec<u8>>>>,
}

impl AsyncRead for RecordingPipe {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_read(context, buffer)
    }
}

impl AsyncWrite for RecordingPipe {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.pipe).poll_write(context, bytes);
        if let Poll::Ready(Ok(length)) = written {
            self.writes.lock().unwrap().push(bytes[..length].to_vec());
        }
        written
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_shutdown(context)
    }
}

#[tokio::test(start_paused = true)]
async fn each_message_is_a_separate_write() {
    let handle = detached(playpen(), spykee::sim::Firmware::default());
    let (stream, pipe) = tokio::io::duplex(64 * 1024);
    let writes = Arc::<Mutex<Vec<Vec<u8>>>>::default();
    handle.connect(RecordingPipe {
        pipe,
        writes: writes.clone(),
    });
    let mut client = Client { stream }.log_in().await;
    client.send(&[VIDEO_ON, AUDIO_ON].concat()).await;
    client.send(b"PK\x0D\x00\x00PK\x11\x00\x00").await;
    for _ in 0..200 {
        client.next().await.unwrap();
    }
    let writes = writes.lock().unwrap();
    for bytes in writes.iter() {
        let length = usize::from(bytes[3]) << 8 | usize::from(bytes[4]);
        assert_eq!((&bytes[..2], bytes.len()), (&b"PK"[..], 5 + length));
    }
    assert!(writes.len() >= 200, "{}", writes.len());
}

#[tokio::test(start_paused = true)]
async fn the_microphone_sends_an_eighth_of_a_second_at_uneven_times() {
    let (handle, mut client) = robot(playpen()).await;
    client.send(AUDIO_ON).await;
    let mut usual = 0;
    let mut gaps = Vec::new();
    let mut last = handle.state().time;
    for _ in 0..100 {
        let message = client.next_of_kind(1).await;
        usual += usize::from(message.len() == 5 + 4000);
        let now = handle.state().time;
        gaps.push(now - last);
        last = now;
    }
    assert!(
        (70..100).contains(&usual),
        "{usual} of 100 have 2,000 samples"
    );
    gaps.sort_unstable();
    gaps.dedup();
    assert!(gaps.len() > 4, "{gaps:?}");
}

#[tokio::test]
async fn one_address_answers_broadcasts_to_its_network_too() {
    let server = Server::bind(playpen(), Options::default()).await.unwrap();
    let address = server.local_addr();
    tokio::spawn(server.run());
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    socket.set_broadcast(true).unwrap();
    let mut reply = [0; 64];
    for _ in 0..50 {
        let target = ("127.255.255.255", address.port());
        socket.send_to(b"DSCV\x01", target).await.unwrap();
        let answer = timeout(Duration::from_millis(200), socket.recv_from(&mut reply)).await;
        if let Ok(Ok((length, from))) = answer {
            assert_eq!(from, address, "answered from where clients connect");
            assert_eq!(&reply[..length], b"DSCV\x02\x0Euid=SPYKEE0001");
            return;
        }
    }
    panic!("no answer to the broadcast");
}

/// The segments of a JPEG up to its pixels: marker and content.
fn segments(jpeg: &[u8]) -> Vec<(u8, &[u8])> {
    let mut at = 2;
    let mut found = Vec::new();
    while let Some([0xFF, marker, high, low]) = jpeg.get(at..at + 4) {
        let end = at + 2 + (usize::from(*high) << 8 | usize::from(*low));
        found.push((*marker, &jpeg[at + 4..end]));
        if *marker == 0xDA {
            break;
        }
        at = end;
    }
    found
}

/// The tables of Annex K of the JPEG standard, in file order: quality 50.
const LUMA_50: [u8; 12] = [16, 11, 12, 14, 12, 10, 16, 14, 13, 14, 18, 17];

#[tokio::test(start_paused = true)]
async fn frames_are_compressed_as_genuine_ones_are() {
    let (_handle, mut client) = robot(crate::rig::exact("living_room")).await;
    client.send(&[VIDEO_ON, TURN_LEFT_90].concat()).await;
    let mut bytes = 0;
    for _ in 0..60 {
        let message = client.next_of_kind(2).await;
        let jpeg = &message[5..];
        assert!((2_000..9_000).contains(&jpeg.len()), "{} bytes", jpeg.len());
        bytes += jpeg.len();
        let segments = segments(jpeg);
        let of = |wanted: u8| {
            segments
                .iter()
                .find(|(marker, _)| *marker == wanted)
                .unwrap()
                .1
        };
        assert_eq!(of(0xE0)[..7], *b"JFIF\0\x01\x01");
        assert_eq!(of(0xDB)[1..13], LUMA_50);
        // 8 bits, 240 rows, 320 columns, three components: 4:2:0.
        let frame = [8, 0, 240, 1, 64, 3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1];
        assert_eq!(*of(0xC0), frame);
        assert_eq!(of(0xDA)[..7], [3, 1, 0x00, 2, 0x11, 3, 0x11]);
    }
    assert!(
        (3_000..7_000).contains(&(bytes / 60)),
        "{} bytes in the mean",
        bytes / 60
    );
}

#[test]
fn bearings_are_within_a_degree_all_over_the_picture() {
    let camera = spykee::vision::Camera::default();
    let mut analyser = spykee::vision::FrameAnalyser::new(camera);
    let red = spykee::vision::Colour::named("red").unwrap();
    let mut seen = 0;
    for step in 0..72 {
        let degrees = -23.4 + 0.65 * f64::from(step);
        for (away, radius) in [(1.3, 0.05), (2.0, 0.1)] {
            let world = format!(
                "room: {{ width: 8, depth: 8 }}\nstation: {{ at: [0, 4], heading_degrees: 0 }}\n\
                 start: {{ at: [4, 4], heading_degrees: 0 }}\ncamera: {{ noise: 0.25 }}\n\
                 balls: [{{ at: [{}, {}], colour: red, radius: {radius} }}]\n",
                4.1 + away * degrees.to_radians().cos(),
                4.0 + away * degrees.to_radians().sin(),
            );
            let world = spykee::sim::World::from_yaml(&world, "bearings").unwrap();
            let mut robot = spykee::sim::Robot::new(world, spykee::sim::Firmware::default(), 1);
            robot.begin_session();
            robot.execute(&spykee::wire::Command::Stream {
                stream: spykee::wire::Stream::Video,
                on: true,
            });
            let jpeg = loop {
                robot.step(Duration::from_millis(20));
                let mut reports = robot.take_reports().into_iter();
                let frame = reports.find_map(|report| match report {
                    spykee::wire::Report::Video(jpeg) => Some(jpeg),
                    _ => None,
                });
                if let Some(jpeg) = frame {
                    break jpeg;
                }
            };
            let options = spykee::vision::BlobOptions::default();
            let key = (step * 2) as u64 + u64::from(away > 1.0);
            let blobs = analyser.find_blobs(key, &jpeg, &[red], &options).unwrap();
            // At the border only a part of it is visible.
            if let Some(ball) = blobs.first().filter(|ball| !ball.edge) {
                let off = ball.bearing.to_degrees() - degrees;
                assert!(
                    off.abs() < 1.0,
                    "at {degrees} degrees, {away} m: {off} degrees off"
                );
                seen += 1;
            }
        }
    }
    assert!(seen > 110, "{seen}");
}

#[test]
fn statistics_of_frames_are_told_for_worlds_and_for_folders() {
    let frames = simulated(playpen());
    assert_eq!(frames.len(), 12);
    let folder = tempfile::tempdir().unwrap();
    for (number, frame) in frames.iter().enumerate() {
        std::fs::write(folder.path().join(format!("{number:02}.jpg")), frame).unwrap();
    }
    let of_world = Statistics::of(&frames).unwrap();
    let of_folder = Statistics::of(&frames_in(folder.path()).unwrap()).unwrap();
    assert_eq!(of_world, of_folder);
    let row = format!("{:20} {of_world}", "playpen");
    assert_eq!(row.len(), Statistics::HEAD.len(), "{row}");
    assert!((20.0..235.0).contains(&of_world.middle), "{of_world}");
    assert!(of_world.noise > 0.0 && of_world.edges > 1.0, "{of_world}");

    let mut grey = Vec::new();
    image::RgbImage::from_pixel(320, 240, image::Rgb([120, 110, 100]))
        .write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(
            &mut grey, 95,
        ))
        .unwrap();
    let even = Statistics::of(&[grey]).unwrap();
    assert!(
        (even.middle - 110.0).abs() < 2.0 && (even.corners - 110.0).abs() < 2.0,
        "{even}"
    );
    assert!((even.middle_cast[0] - 10.0).abs() < 3.0, "{even}");
    assert!(
        (even.saturation - 42.5).abs() < 8.0 && even.noise < 0.5,
        "{even}"
    );

    let empty = tempfile::tempdir().unwrap();
    assert!(
        frames_in(empty.path())
            .unwrap_err()
            .contains("no JPEG files")
    );
    assert!(Statistics::of(&[b"no picture".to_vec()]).is_err());
}
