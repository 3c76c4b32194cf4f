//! What is found out by driving, through the pilot and its watchdog.

use std::net::Shutdown;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

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
use crate::vision::{Camera, Decoder, Glance};
use crate::wire::Stream;

/// Powers that are tried, percent.
const POWERS: std::ops::RangeInclusive<u8> = 5..=47;
const POWER_STEP: usize = 3;
const PULSE: Duration = Duration::from_millis(600);
/// How long pictures may be late, and the exposure may take.
const SETTLING: Duration = Duration::from_millis(700);
const FRAME_TIMEOUT: Duration = Duration::from_secs(2);
/// Views of the standing robot, whose differences are noise.
const STANDING_VIEWS: usize = 6;
/// The robot has moved if its view differs by this many times the noise, and this much more.
const MOVED: (f64, f64) = (4.0, 0.4);

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
const BEFORE_CUT: Duration = Duration::from_secs(1);
const CUT: Duration = Duration::from_secs(1);
const RECONNECTING: Duration = Duration::from_secs(60);
/// The way back is so much longer, to see that it passes where it began: a stop may have waited in
/// the robot's queue.
const FARTHER: Duration = Duration::from_millis(1500);
/// It drove on if it did so for this share of the time until it was stopped.
const DROVE_ON: f64 = 0.6;
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
        noise: 0.0,
        see_motion: false,
    };
    let sees = eyes.learn_noise().await;
    let least = least_power(walk, driver, &mut eyes, sees).await?;
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
    /// The most by which two views differ while the robot stands.
    noise: f64,
    /// Whether a motion was seen.
    see_motion: bool,
}

impl Eyes {
    /// The next picture, if one comes and can be used.
    async fn next(&mut self) -> Option<View> {
        timeout(FRAME_TIMEOUT, self.frames.changed())
            .await
            .ok()?
            .ok()?;
        self.newest()
    }

    fn newest(&mut self) -> Option<View> {
        let frame = self.frames.borrow_and_update().newest.clone()?;
        let image = self.decoder.decode(&frame.jpeg).ok()?;
        let glance = Glance::new(image, self.camera)?;
        Some(View {
            at: frame.at,
            glance,
        })
    }

    /// What the standing robot sees.
    async fn settled(&mut self) -> Option<Glance> {
        sleep(SETTLING).await;
        self.frames.mark_unchanged();
        self.next().await.map(|view| view.glance)
    }

    /// Measures the noise; `false`: there are no pictures.
    async fn learn_noise(&mut self) -> bool {
        let mut views: Vec<Glance> = Vec::new();
        for _ in 0..STANDING_VIEWS {
            views.extend(self.settled().await);
        }
        for (number, view) in views.iter().enumerate() {
            for other in &views[..number] {
                self.noise = self.noise.max(view.difference(other));
            }
        }
        views.len() >= 2
    }

    fn differ(&self, one: &Glance, other: &Glance) -> bool {
        let (times, more) = MOVED;
        one.difference(other) > times * self.noise + more
    }

    /// How long it had moved, from where it saw `first`, when it took the view of this number.
    fn moved_until(&self, first: &Glance, views: &[View], number: usize) -> Option<Duration> {
        let begins = views.iter().find(|view| self.differ(&view.glance, first))?;
        Some(views.get(number)?.at.saturating_duration_since(begins.at))
    }

    /// The number of the view that shows `start` again, on the way from `after` to beyond it.
    fn likest(&self, start: &Glance, after: &Glance, views: &[View]) -> Option<usize> {
        let differences = views.iter().map(|view| view.glance.difference(start));
        let least = differences
            .enumerate()
            .min_by(|(_, one), (_, other)| one.total_cmp(other));
        let (number, difference) = least?;
        let is_recognised = difference < RECOGNISED * after.difference(start);
        (is_recognised && number + 1 < views.len()).then_some(number)
    }

    /// Awaits a motion, and returns its result and what was seen meanwhile.
    async fn watch<T>(&mut self, motion: impl Future<Output = T>) -> (T, Vec<View>) {
        let mut motion = pin!(motion);
        let mut views = Vec::new();
        loop {
            tokio::select! {
                biased;
                done = &mut motion => return (done, views),
                Ok(()) = self.frames.changed() => views.extend(self.newest()),
            }
        }
    }
}

/// Turns it left and right with rising power until its pictures change.
async fn least_power(
    walk: &mut Walk,
    driver: &mut Driver,
    eyes: &mut Eyes,
    sees: bool,
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
    for percent in POWERS.step_by(POWER_STEP) {
        print(&format!("     {percent} %\n"))?;
        let power = f64::from(percent);
        let start = eyes.settled().await;
        drive_once(driver, turn(power), PULSE).await?;
        let turned = eyes.settled().await;
        drive_once(driver, turn(-power), PULSE).await?;
        let back = eyes.settled().await;
        let moved = match (start, turned, back) {
            // Twice: somebody may walk by.
            (Some(start), Some(turned), Some(back)) => {
                eyes.differ(&start, &turned) && eyes.differ(&turned, &back)
            }
            _ => false,
        };
        if moved {
            let below = percent.saturating_sub(POWER_STEP as u8);
            let found = if below >= *POWERS.start() {
                format!("{percent} % turns it on the spot, {below} % does not: scripts use more")
            } else {
                format!("{percent} % or less turns it on the spot")
            };
            walk.measured(WHAT, &found)?;
            eyes.see_motion = true;
            return Ok(Some(percent));
        }
    }
    let why = if sees {
        "its pictures did not change"
    } else {
        "it sends no pictures"
    };
    ask_least_power(walk, WHAT, why).await
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
        Some(percent) => walk.asked(what, &format!("{percent} % turns it on the spot"))?,
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
        "\n7  It turns on the spot at {power} % for two seconds; in the second one the connection is \
         cut. Then it turns back.\n"
    ))?;
    if !walk.agrees("Is there room around it?").await? {
        return walk.unknown(WHAT, "skipped");
    }
    let (drove, apart) = match turn_and_cut(driver, eyes, cut, f64::from(power)).await? {
        Ok(turned) => turned,
        Err(why) => return walk.unknown(WHAT, why),
    };
    if let Some(drove) = drove {
        let seconds = drove.as_secs_f64();
        let found = if seconds > DROVE_ON * apart.as_secs_f64() {
            "it drives on".to_owned()
        } else {
            format!("it stops by itself, after about {seconds:.1} s")
        };
        return walk.measured(WHAT, &found);
    }
    let asks = "Did it stop when the connection was cut (s), or drive on for a second (d)? Enter: not seen";
    match walk.types(asks).await?.as_str() {
        "s" => walk.asked(WHAT, "it stops by itself"),
        "d" => walk.asked(WHAT, "it drives on"),
        _ => walk.unknown(WHAT, "its pictures do not tell; count on its driving on"),
    }
}

/// Turns, cuts the connection meanwhile, and turns back. Returns for how long it drove without a
/// connection, if that was seen, and the time until it was stopped; or why it is not known.
async fn turn_and_cut(
    driver: &mut Driver,
    eyes: &mut Eyes,
    cut: &LinkCut,
    power: f64,
) -> Result<Result<(Option<Duration>, Duration), &'static str>, Failure> {
    ready(driver.status())?;
    let start = eyes.settled().await;
    let began = Instant::now();
    let driving = async {
        let motion = driver.ask(async |client| client.run(turn(power), BEFORE_CUT + 2 * CUT).await);
        let cutting = async {
            sleep(BEFORE_CUT).await;
            cut.cut(CUT);
        };
        tokio::join!(motion, cutting).0
    };
    let (ended, views) = eyes.watch(driving).await;
    if ended? != MotionEnd::Disconnected {
        return Ok(Err("the connection could not be cut"));
    }
    if timeout(RECONNECTING, driver.connected()).await.is_err() {
        return Ok(Err("it could not be reached again in time"));
    }
    let apart = began.elapsed().saturating_sub(BEFORE_CUT);
    let after = eyes.settled().await;
    let driving = drive_once(driver, turn(-power), BEFORE_CUT + apart + FARTHER);
    let (ended, views_back) = eyes.watch(driving).await;
    ended?;
    let drove = match (&start, &after) {
        // If its pictures have shown no motion, one that does not change tells nothing.
        (Some(start), Some(after)) if eyes.see_motion => {
            let there = eyes.moved_until(start, &views, views.len().saturating_sub(1));
            let likest = eyes.likest(start, after, &views_back);
            let back = likest.and_then(|number| eyes.moved_until(after, &views_back, number));
            back.zip(there)
                .map(|(back, there)| back.saturating_sub(there))
        }
        _ => None,
    };
    Ok(Ok((drove, apart)))
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
            *newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(supervision.accepted());
            let begins = *from.borrow();
            let connecting = connector(supervision);
            Box::pin(async move {
                sleep_until(begins).await;
                connecting.await
            })
        });
        let disconnect = move || {
            let link = link.lock().unwrap_or_else(PoisonError::into_inner).clone();
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
