//! What is found out by driving, through the pilot and its watchdog.

use std::net::Shutdown;
use std::ops::{Range, RangeInclusive};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::watch;
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::Walk;
use crate::cli::calibrate::{drive_once, ready, turn};
use crate::cli::driver::Driver;
use crate::cli::{Failure, print};
use crate::link::AcceptedLogin;
use crate::pilot::{Connector, Settings};
use crate::robot::{Intent, MotionEnd, Pictures};
use crate::safety::{Limits, PowerMeaning};
use crate::vision::{Camera, Decoder, Glance, moved_right};
use crate::wire::Stream;

/// Powers that are tried, percent.
const POWERS: RangeInclusive<u8> = 5..=47;
const POWER_STEP: usize = 3;
const PULSE: Duration = Duration::from_millis(600);
/// How long pictures may be late, and the exposure may take.
const SETTLING: Duration = Duration::from_millis(700);
const FRAME_TIMEOUT: Duration = Duration::from_secs(2);
/// How often a power is tried until two tries agree that it turns: somebody may walk by.
const TRIES: usize = 5;
/// What is seen stands if it moves by no more than this many tiles of a view.
const STILL: isize = 1;

/// Turns on the spot that load the battery.
const TURNING_POWER: f64 = 50.0;
const TURNING: Duration = Duration::from_secs(1);
/// How long POWER may be late.
const POWER_DELAY: Duration = Duration::from_secs(7);
/// Points by which a voltage rises again when the tracks stand.
const SAG: u8 = 3;

/// The turn with the cut: power above the least one, or without one; the time before the cut, and
/// the time without a connection.
const CUT_POWER_ABOVE: u8 = 8;
const CUT_POWER: u8 = 30;
const MAX_CUT_POWER: u8 = 45;
const BEFORE_CUT: Duration = Duration::from_millis(1200);
const CUT: Duration = Duration::from_secs(2);
const RECONNECTING: Duration = Duration::from_secs(60);
/// The way back is so much longer, to see that it passes where it began: a stop may have waited in
/// the robot's queue.
const FARTHER: Duration = Duration::from_millis(1500);
/// It drove on if it did so for about this share of the time without a connection, and stopped if it
/// did so for less than that one. It is stopped by the next login, a little later.
const DROVE_ON: Range<f64> = 0.85..1.5;
const STOPPED: f64 = 0.7;
/// A view is recognised if it differs by less than this share of another one's difference: between
/// two pictures the robot turns by some degrees.
const RECOGNISED: f64 = 0.75;

pub(super) async fn drive_about(
    walk: &mut Walk,
    driver: &mut Driver,
    cut: &LinkCut,
) -> Result<(), Failure> {
    ready(driver.status())?;
    show(driver, true).await?;
    let mut eyes = Eyes {
        frames: driver.frames(),
        decoder: Decoder::default(),
        camera: walk.camera,
    };
    let least = least_power(walk, driver, &mut eyes).await?;
    sag(walk, driver).await?;
    disconnect(walk, driver, &mut eyes, cut, least).await?;
    show(driver, false).await
}

async fn show(driver: &mut Driver, on: bool) -> Result<(), Failure> {
    let stream = Stream::Video;
    let shown = driver.ask(async |client| client.send_intent(Intent::Stream { stream, on }).await);
    shown.await
}

/// Levels as the robot reports them: whether they sag is to be seen.
pub(super) fn as_reported(settings: Settings) -> Settings {
    Settings {
        limits: Limits {
            power: PowerMeaning::Percent,
            ..settings.limits
        },
        ..settings
    }
}

struct View {
    at: Instant,
    glance: Glance,
}

struct Eyes {
    frames: watch::Receiver<Pictures>,
    decoder: Decoder,
    camera: Camera,
}

impl Eyes {
    fn newest(&mut self) -> Option<View> {
        let frame = self.frames.borrow_and_update().newest.clone()?;
        let image = self.decoder.decode(&frame.jpeg).ok()?;
        let glance = Glance::new(image, self.camera)?;
        Some(View {
            at: frame.at,
            glance,
        })
    }

    /// Awaits a motion, and returns its result and what was seen meanwhile, after a picture of the
    /// robot that still stands.
    async fn watch<T>(&mut self, motion: impl Future<Output = T>) -> (T, Vec<View>) {
        self.frames.mark_unchanged();
        let _ = timeout(FRAME_TIMEOUT, self.frames.changed()).await;
        let mut views: Vec<View> = self.newest().into_iter().collect();
        let mut motion = pin!(motion);
        loop {
            tokio::select! {
                biased;
                done = &mut motion => return (done, views),
                Ok(()) = self.frames.changed() => views.extend(self.newest()),
            }
        }
    }
}

/// Whether what is seen has not moved; not if it is not seen again.
fn stands(moved: Option<isize>) -> bool {
    moved.is_some_and(|tiles| tiles.abs() <= STILL)
}

/// Turns it left and right with rising power until its pictures move.
async fn least_power(
    walk: &mut Walk,
    driver: &mut Driver,
    eyes: &mut Eyes,
) -> Result<Option<u8>, Failure> {
    const WHAT: &str = "least power";
    print(
        "\n5  It turns on the spot, left and right in turn, with rising power, until it is seen to \
         move.\n",
    )?;
    if !walk.agrees("Is there room around it?").await? {
        walk.unknown(WHAT, "skipped")?;
        return Ok(None);
    }
    let mut why = "its pictures did not change";
    for percent in POWERS.step_by(POWER_STEP) {
        print(&format!("     {percent} %\n"))?;
        let Some(turned) = turns(driver, eyes, f64::from(percent)).await? else {
            why = "its pictures do not tell, or something else moves";
            break;
        };
        if turned {
            let below = percent.saturating_sub(POWER_STEP as u8);
            let found = if below >= *POWERS.start() {
                format!("{percent} % turns it on the spot, {below} % does not")
            } else {
                format!("{percent} % or less turns it on the spot")
            };
            walk.measured(WHAT, &found)?;
            walk.set_least_power(percent);
            return Ok(Some(percent));
        }
    }
    ask_least_power(walk, WHAT, why).await
}

/// Whether this power turns it, left and right; `None` if its pictures do not tell.
async fn turns(driver: &mut Driver, eyes: &mut Eyes, power: f64) -> Result<Option<bool>, Failure> {
    let mut turned = 0;
    for _ in 0..TRIES {
        let left = pulse(driver, eyes, power).await?;
        let right = pulse(driver, eyes, -power).await?;
        if stands(left) && stands(right) {
            return Ok(Some(false));
        }
        if left > Some(STILL) && right.is_some_and(|tiles| tiles < -STILL) {
            turned += 1;
        }
        if turned == 2 {
            return Ok(Some(true));
        }
    }
    Ok(None)
}

/// By how many tiles what is seen moves to the right in a short turn; `None` if its pictures do not
/// tell.
async fn pulse(driver: &mut Driver, eyes: &mut Eyes, power: f64) -> Result<Option<isize>, Failure> {
    let turning = async {
        drive_once(driver, turn(power), PULSE).await?;
        sleep(SETTLING).await;
        Ok(())
    };
    let (ended, views) = eyes.watch(turning).await;
    ended.map(|()| moved_right(views.iter().map(|view| &view.glance)))
}

async fn ask_least_power(
    walk: &mut Walk,
    what: &'static str,
    why: &str,
) -> Result<Option<u8>, Failure> {
    let asks = format!("{why}. At which percentage did it begin to move? Enter: it did not");
    let told = walk.types(&asks).await?;
    let told = told.trim_end_matches('%').trim().parse().ok();
    let told = told.filter(|percent| POWERS.contains(percent));
    match told {
        Some(percent) => {
            walk.asked(what, &format!("{percent} % turns it on the spot"))?;
            walk.set_least_power(percent);
        }
        None => walk.unknown(what, why)?,
    }
    Ok(told)
}

/// Whether POWER falls while the tracks run.
async fn sag(walk: &mut Walk, driver: &mut Driver) -> Result<(), Failure> {
    const WHAT: &str = "POWER is";
    print("\n6  It turns left and right on the spot, to see whether POWER falls meanwhile.\n")?;
    if !walk.agrees("Is there room around it?").await? {
        return walk.unknown(WHAT, "skipped");
    }
    let level = |driver: &Driver| driver.status().battery.and_then(|battery| battery.percent);
    let Some(mut least) = level(driver) else {
        return walk.unknown(WHAT, "its level is not known");
    };
    for power in [TURNING_POWER, -TURNING_POWER] {
        drive_once(driver, turn(power), TURNING).await?;
        least = level(driver).map_or(least, |level| least.min(level));
    }
    let until = Instant::now() + POWER_DELAY;
    while Instant::now() < until {
        sleep(Duration::from_millis(100)).await;
        least = level(driver).map_or(least, |level| least.min(level));
    }
    // A share does not rise again.
    let after = level(driver).unwrap_or(least);
    let sagged = after.get().saturating_sub(least.get());
    if sagged >= SAG {
        walk.watchdog.push("power: voltage");
        let found = format!("a voltage: it was {sagged} points lower while the tracks ran");
        walk.measured(WHAT, &found)
    } else {
        walk.measured(WHAT, "a share: it is the same while the tracks run")
    }
}

/// Whether the tracks go on when the connection ends. The robot then turns back past where it
/// began: the time until it sees that tells for how long it went on.
async fn disconnect(
    walk: &mut Walk,
    driver: &mut Driver,
    eyes: &mut Eyes,
    cut: &LinkCut,
    least: Option<u8>,
) -> Result<(), Failure> {
    const WHAT: &str = "without a connection";
    let power = least.map_or(CUT_POWER, |least| least + CUT_POWER_ABOVE);
    let power = power.min(MAX_CUT_POWER);
    print(&format!(
        "\n7  It turns on the spot at {power} %; after a second the connection is cut for two seconds. \
         Then it turns back.\n"
    ))?;
    if !walk.agrees("Is there room around it?").await? {
        return walk.unknown(WHAT, "skipped");
    }
    if let Some(drove) = turn_and_cut(driver, eyes, cut, f64::from(power)).await? {
        let seconds = drove.as_secs_f64();
        let share = seconds / CUT.as_secs_f64();
        if DROVE_ON.contains(&share) {
            return walk.measured(WHAT, "it drives on");
        } else if share < STOPPED {
            let found = format!("it stops by itself, after about {seconds:.1} s");
            return walk.measured(WHAT, &found);
        }
    }
    let asks = "Did it stop when the connection was cut (s), or drive on (d)? Enter: not seen";
    match walk.types(asks).await?.as_str() {
        "s" => walk.asked(WHAT, "it stops by itself"),
        "d" => walk.asked(WHAT, "it drives on"),
        _ => walk.unknown(WHAT, "its pictures do not tell; count on its driving on"),
    }
}

/// Turns, cuts the connection meanwhile, and turns back. Returns for how long it drove without a
/// connection, if that was seen.
async fn turn_and_cut(
    driver: &mut Driver,
    eyes: &mut Eyes,
    cut: &LinkCut,
    power: f64,
) -> Result<Option<Duration>, Failure> {
    ready(driver.status())?;
    let driving = async {
        let motion = driver.ask(async |client| client.run(turn(power), BEFORE_CUT + 2 * CUT).await);
        let cutting = async {
            sleep(BEFORE_CUT).await;
            cut.cut(CUT);
        };
        tokio::join!(motion, cutting).0
    };
    let (ended, there) = eyes.watch(driving).await;
    if ended? != MotionEnd::Disconnected || timeout(RECONNECTING, driver.connected()).await.is_err()
    {
        return Ok(None);
    }
    sleep(SETTLING).await;
    let long = BEFORE_CUT + CUT + FARTHER;
    let driving = driver.ask(async |client| client.run(turn(-power), long).await);
    let (ended, back) = eyes.watch(driving).await;
    Ok(match ended? {
        MotionEnd::Done => unseen_turn(&there, &back),
        _ => None,
    })
}

/// How long it turned after the last view of the way there, if the way back leads past where the
/// first one was taken.
fn unseen_turn(there: &[View], back: &[View]) -> Option<Duration> {
    let start = there.first()?;
    let differs = |view: &View| view.glance.difference(&start.glance);
    let likest = back
        .iter()
        .min_by(|one, other| differs(one).total_cmp(&differs(other)))?;
    let is_passed = likest.at < back.last()?.at;
    let is_recognised = differs(likest) < RECOGNISED * differs(back.first()?);
    let whole = moved_until(back, likest)?;
    let seen = moved_until(there, there.last()?)?;
    (is_passed && is_recognised).then(|| whole.saturating_sub(seen))
}

/// How long it had moved when it took the last one of these views.
fn moved_until(views: &[View], last: &View) -> Option<Duration> {
    let moved = |view: &&View| !stands(view.glance.moved_since(&views[0].glance));
    let begins = views.iter().find(moved)?;
    Some(last.at.saturating_duration_since(begins.at))
}

/// Cuts the link of a pilot as a lost network does, and keeps it cut for a while. The pilot then
/// owes a stop: it connects as soon as it may, and the guardian does if this program is gone.
pub(super) struct LinkCut {
    /// No attempt to connect begins before.
    until: watch::Sender<Instant>,
    pub(super) disconnect: Box<dyn Fn() + Send + Sync>,
}

impl LinkCut {
    /// A connector that connects as this one does, and what cuts its links.
    pub(super) fn new(mut connector: Connector) -> (Connector, LinkCut) {
        let until = watch::Sender::new(Instant::now());
        let from = until.subscribe();
        let newest: Arc<Mutex<Option<watch::Receiver<Option<AcceptedLogin>>>>> = Arc::default();
        let link = newest.clone();
        let connector: Connector = Box::new(move |supervision| {
            *newest.lock() = Some(supervision.accepted());
            let begins = *from.borrow();
            let connecting = connector(supervision);
            Box::pin(async move {
                sleep_until(begins).await;
                connecting.await
            })
        });
        let disconnect = move || {
            let link = link.lock().clone();
            if let Some(login) = link.and_then(|link| link.borrow().clone()) {
                // A socket that is closed already is cut.
                let _ = login.socket.shutdown(Shutdown::Both);
            }
        };
        let disconnect = Box::new(disconnect);
        (connector, LinkCut { until, disconnect })
    }

    /// Ends the connection without a word, and allows the next one after this time.
    fn cut(&self, time: Duration) {
        self.until.send_replace(Instant::now() + time);
        (self.disconnect)();
    }
}
