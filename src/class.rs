//! A class in the browser: one server on the teacher's computer, a page for each learner, a wall for
//! all. Each learner has files in a folder and at most one run, a confined process (`learner`) that
//! only this server reaches; the learner's page sees it through the server. Real robots have agents
//! of their own (`robot`), and learners take turns on them. What is decided is pure (`members`,
//! `queue`); this file holds the state and has the effects.

mod children;
mod files;
mod learner;
mod members;
mod queue;
mod robot;
mod robots;
mod routes;

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::http::StatusCode;
use parking_lot::{Mutex, MutexGuard};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;

pub use self::children::RobotSetup;
use self::children::{Child, Launcher, ask, no_run};
use self::files::Files;
pub use self::learner::{LEARNER, learner_main};
use self::learner::{RunNews, RunPlan, traced};
use self::members::{Device, Member, Members, RunState, TEACHER, class_word};
use self::queue::TurnError;
pub use self::robot::RobotAgent;
use self::robots::Robots;
use crate::agent::Change;
use crate::clock::every;
use crate::control::RunRequest;
use crate::http::{self, Access, AccessError, Keyring, Options, Refusal, Role};
use crate::rate_limit::TokenBucket;
use crate::sim::World;

/// The place of a script that belongs to no lesson.
const FREE: &str = "free";
/// The points of a lesson.
const POINTS: u64 = 10;
/// Checks, and inspections of texts, at the same time.
const CHECKS: usize = 2;
/// How often runs that nobody needs are looked for.
const SWEEP: Duration = Duration::from_secs(5);
/// How often it is looked for turns that are over.
const BEAT: Duration = Duration::from_millis(250);
/// A run whose script has ended stays this long, one that nobody looks at so long.
const AFTER_END: Duration = Duration::from_secs(120);
const UNSEEN: Duration = Duration::from_secs(60);
/// Runs and checks of a learner: so many at once, and then so many per second.
const ACTS: f64 = 10.0;
const ACTS_RATE: f64 = 1.0;
/// Inspections of a text: one after each pause while somebody types.
const MARKS: f64 = 20.0;
const MARKS_RATE: f64 = 2.0;

/// A lesson as learners get it.
#[derive(Debug, Clone)]
pub struct Lesson {
    /// Such as `03-moving`.
    pub name: &'static str,
    pub title: &'static str,
    pub world: &'static str,
    /// Its text, in Markdown.
    pub readme: &'static str,
    pub starter: &'static str,
}

/// Tells what a script lacks, as JSON; the error is for the teacher. Blocks.
pub type Judge = Box<dyn Fn(&str, &Path) -> Result<Value, String> + Send + Sync>;

/// What the class uses of the program.
pub struct Tools {
    pub lessons: Vec<Lesson>,
    /// Plays the scenarios of this lesson with the script in this file: the points, and the `sentence`
    /// that says what is missing.
    pub check: Judge,
    /// Finds mistakes in this text without running it; the file is where it will be.
    pub marks: Judge,
}

/// What the server is started with.
pub struct Setup {
    pub folder: PathBuf,
    /// The teacher's list.
    pub names: Vec<String>,
    pub options: Options,
    pub tools: Tools,
    /// Learners take turns on these.
    pub robots: Vec<RobotSetup>,
}

impl Setup {
    /// The data folder of a robot's agent, in this folder of a class.
    pub fn robot_folder(class: &Path, name: &str) -> PathBuf {
        Files::own_of(class).join("robots").join(name)
    }
}

/// Why a class cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ClassError {
    #[error("cannot use the folder of the class {path}: {source}")]
    Folder { path: String, source: io::Error },
    #[error("the class cannot be served at {address}: {source}")]
    Socket {
        address: SocketAddr,
        source: io::Error,
    },
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// A class that is open, but not served yet.
pub struct OpenClass {
    class: Arc<Class>,
    listener: TcpListener,
    access: Arc<Access>,
    pub address: SocketAddr,
    /// Opens the wall.
    pub token: String,
    pub word: String,
}

impl OpenClass {
    /// Opens the folder and the address. `link` makes the learners' link of the address in use.
    pub async fn open(
        setup: Setup,
        link: impl FnOnce(SocketAddr) -> String,
    ) -> Result<OpenClass, ClassError> {
        let path = setup.folder.display().to_string();
        let unusable = |source| ClassError::Folder { path, source };
        let files = Files::open(&setup.folder).map_err(unusable.clone())?;
        let own = files.own();
        let mut keys = Keyring::open(&own)?;
        keys.revoke(TEACHER)?;
        let token = keys.make(TEACHER, Role::Driver)?;
        let address = setup.options.address();
        let refused = |source| ClassError::Socket { address, source };
        let listener = TcpListener::bind(address).await.map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let access = Arc::new(Access::new(&setup.options, address, &own)?);
        let word = class_word(rand::random());
        let members = members_of(&files, &word, &setup.names).map_err(unusable.clone())?;
        let launcher = Launcher::new(&own.join("runs")).map_err(unusable)?;
        let class = Arc::new(Class {
            state: Mutex::new(State {
                members,
                robots: Robots::new(setup.robots),
                ..State::default()
            }),
            files,
            tools: setup.tools,
            launcher,
            changed: watch::Sender::new(()),
            checks: Semaphore::new(CHECKS),
            inspections: Semaphore::new(CHECKS),
            word: word.clone(),
            link: link(address),
        });
        Ok(OpenClass {
            class,
            listener,
            access,
            address,
            token,
            word,
        })
    }

    /// Serves the class; never returns. Dropping the future ends all runs.
    pub async fn serve(self) {
        let class = self.class.clone();
        let _keeping = AbortOnDropHandle::new(tokio::spawn(async move {
            let mut sweep = every(SWEEP);
            let mut beat = every(BEAT);
            loop {
                tokio::select! {
                    _ = sweep.tick() => class.sweep(Instant::now()),
                    _ = beat.tick() => class.beat(Instant::now()),
                }
            }
        }));
        let router = routes::routes(self.class, self.access);
        http::serve(self.listener, router).await;
    }
}

/// The learners of earlier days, those of the teacher's list, and those who have a folder.
fn members_of(files: &Files, word: &str, names: &[String]) -> io::Result<Members> {
    let mut members = Members::new(word, files.records()?);
    for name in names {
        if let Err(error) = members.expect(name) {
            tracing::warn!("`{name}` in the list of names: {error}");
        }
    }
    for name in files.learners()? {
        // A folder with another name is not a learner's.
        let _ = members.expect(&name);
    }
    Ok(members)
}

/// Who sends a request.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Caller {
    Teacher,
    /// A cookie; whose it is may change.
    Device(String),
    Nobody,
}

#[derive(Default)]
struct State {
    members: Members,
    /// The teacher's own workspace.
    teacher: Member,
    runs: HashMap<String, Run>,
    /// By the name of a learner, or `NAME/marks`.
    acts: HashMap<String, TokenBucket>,
    robots: Robots,
    /// Number of runs so far.
    started: u64,
    frozen: bool,
    /// Whether all see the teacher's workspace.
    shown: bool,
    /// Closes what they see of its run.
    screen: CancellationToken,
    /// Whether scripts run in lessons only.
    locked: bool,
    /// The lesson for all.
    lesson: Option<String>,
}

struct Run {
    number: u64,
    child: Child,
    /// Since when nobody looks at it.
    unseen: Option<Instant>,
}

impl State {
    /// Whose workspace is a caller's own.
    fn device(&self, caller: &Caller) -> Device {
        match caller {
            Caller::Teacher => Device::Admitted(TEACHER.to_owned()),
            Caller::Device(cookie) => self.members.device(cookie),
            Caller::Nobody => Device::Unknown,
        }
    }

    fn member(&mut self, name: &str) -> Option<&mut Member> {
        if name == TEACHER {
            Some(&mut self.teacher)
        } else {
            self.members.learners.get_mut(name)
        }
    }

    /// Refuses what a learner may not do now; counts it otherwise.
    fn allow(&mut self, name: &str, now: Instant) -> Result<(), Refusal> {
        if self.frozen && name != TEACHER {
            return Err(TurnError::Frozen.into());
        }
        self.limit(name.to_owned(), ACTS, ACTS_RATE, now)?;
        let member = self.member(name).ok_or_else(unknown_name)?;
        member.act(now);
        Ok(())
    }

    /// Refuses what comes too often: `most` at once, and then so many per second.
    fn limit(&mut self, key: String, most: f64, rate: f64, now: Instant) -> Result<(), Refusal> {
        let bucket = || TokenBucket::new(most, rate);
        if self.acts.entry(key).or_insert_with(bucket).take(1.0, now) {
            return Ok(());
        }
        let why = "too often: wait a moment";
        Err(Refusal::new(StatusCode::TOO_MANY_REQUESTS, why))
    }

    /// What [`State::allow`] does for a script of this lesson, or of free play.
    fn allow_place(&mut self, name: &str, place: &str, now: Instant) -> Result<(), Refusal> {
        self.allow(name, now)?;
        if self.locked && place == FREE && name != TEACHER {
            let why = "the teacher has locked free play";
            return Err(Refusal::new(StatusCode::FORBIDDEN, why));
        }
        Ok(())
    }

    /// Everything stands, or goes on. A run that does not listen is ended.
    fn freeze(&mut self, on: bool) {
        self.frozen = on;
        let mut deaf = Vec::new();
        for (name, run) in &self.runs {
            if let Err(error) = run.child.hold(on) {
                tracing::warn!("{name}: the run cannot be told to stand, and is ended: {error}");
                deaf.push(name.clone());
            }
        }
        for name in deaf {
            self.end_run(&name);
        }
        let now = Instant::now();
        self.robots.queue.freeze(on, now);
        self.take_turns(now);
    }

    /// Shows the teacher's workspace to all, or no longer.
    fn show(&mut self, on: bool) {
        self.shown = on;
        std::mem::take(&mut self.screen).cancel();
    }

    /// Ends and begins turns on the real robots.
    fn take_turns(&mut self, now: Instant) {
        let learners = &self.members.learners;
        let teacher = &self.teacher;
        let here = |name: &str| {
            let member = if name == TEACHER {
                Some(teacher)
            } else {
                learners.get(name)
            };
            member.is_some_and(|member| member.pages > 0)
        };
        self.robots.poll(now, here);
    }
}

/// What to run.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RunOrder {
    lesson: String,
    world: Option<String>,
    speed: Option<f64>,
    /// Whether blocks have made the script.
    #[serde(default)]
    blocks: bool,
    /// Whether the robot only stands in a new world.
    #[serde(default)]
    stands: bool,
}

impl From<TurnError> for Refusal {
    fn from(error: TurnError) -> Refusal {
        let status = match error {
            TurnError::Minutes => StatusCode::UNPROCESSABLE_ENTITY,
            _ => StatusCode::CONFLICT,
        };
        Refusal::new(status, error.to_string())
    }
}

fn not_found(why: &str) -> Refusal {
    Refusal::new(StatusCode::NOT_FOUND, why)
}

fn unknown_name() -> Refusal {
    not_found("there is no learner of this name")
}

fn no_robot() -> Refusal {
    not_found("this robot is not there: its agent does not run")
}

fn internal(error: impl std::fmt::Display) -> Refusal {
    tracing::warn!("{error}");
    let why = format!("the server cannot do this: {error}");
    Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, why)
}

struct Class {
    state: Mutex<State>,
    files: Files,
    tools: Tools,
    launcher: Launcher,
    /// Told of each change of what a page shows.
    changed: watch::Sender<()>,
    checks: Semaphore,
    inspections: Semaphore,
    word: String,
    link: String,
}

impl Class {
    /// The state, for a change that pages show.
    fn change(&self) -> MutexGuard<'_, State> {
        let state = self.state.lock();
        // Viewers look once this guard is gone.
        self.changed.send_replace(());
        state
    }

    fn lesson(&self, name: &str) -> Option<&Lesson> {
        self.tools.lessons.iter().find(|lesson| lesson.name == name)
    }

    /// Checks the name of a lesson or of free play, which becomes that of a file.
    fn place(&self, name: &str) -> Result<String, Refusal> {
        if name == FREE || self.lesson(name).is_some() {
            return Ok(name.to_owned());
        }
        Err(not_found("there is no such lesson"))
    }

    /// Runs work that blocks on the disk or another process.
    async fn block<T: Send + 'static, E: std::fmt::Display + Send + 'static>(
        self: &Arc<Class>,
        work: impl FnOnce(&Class) -> Result<T, E> + Send + 'static,
    ) -> Result<T, Refusal> {
        let class = self.clone();
        let done = tokio::task::spawn_blocking(move || work(&class)).await;
        done.map_err(internal)?.map_err(internal)
    }

    /// Starts a learner's run.
    async fn start(self: &Arc<Class>, name: &str, order: RunOrder) -> Result<(), Refusal> {
        let plan = self.plan(name, order).await?;
        self.launch(name, plan)
    }

    /// Starts a learner's script on the real robot whose turn it is.
    async fn start_turn(self: &Arc<Class>, name: &str, order: RunOrder) -> Result<(), Refusal> {
        // Before the script is read, and again afterwards.
        let driver = self.state.lock().robots.queue.robot_of(name);
        driver.ok_or(TurnError::NoTurn)?;
        let plan = self.plan(name, order).await?;
        Ok(self.change().robots.start(name, plan, Instant::now())?)
    }

    /// What a learner wants to run, if that is allowed now.
    async fn plan(self: &Arc<Class>, name: &str, order: RunOrder) -> Result<RunPlan, Refusal> {
        let place = self.place(&order.lesson)?;
        let lesson = self.lesson(&place);
        let world = order.world.or(lesson.map(|lesson| lesson.world.to_owned()));
        let world = world.unwrap_or_else(|| "yard".to_owned());
        if World::builtin_yaml(&world).is_none() {
            return Err(not_found("there is no such world"));
        }
        let starter = lesson.map_or("", |lesson| lesson.starter).to_owned();
        self.change().allow_place(name, &place, Instant::now())?;
        let source = if order.stands {
            None
        } else {
            let file = format!("{place}.lua");
            let learner = name.to_owned();
            let kept = self.block(move |class| class.files.keep(&learner, &file));
            let source = kept.await?.unwrap_or(starter);
            Some(if order.blocks {
                traced(&source)
            } else {
                source
            })
        };
        Ok(RunPlan {
            name: place,
            source,
            folder: self.files.of(name),
            data: self.files.data_of(name),
            world,
            speed: order.speed.unwrap_or(1.0),
            seed: rand::random(),
        })
    }

    fn launch(self: &Arc<Class>, name: &str, plan: RunPlan) -> Result<(), Refusal> {
        let mut state = self.change();
        state.end_run(name);
        state.started += 1;
        let number = state.started;
        let class = Arc::downgrade(self);
        let learner = name.to_owned();
        let hear = move |news| {
            if let Some(class) = class.upgrade() {
                class.hear(&learner, number, news);
            }
        };
        let mut child = self.launcher.start(&plan, number, hear).map_err(internal)?;
        if state.frozen {
            child.hold(true).map_err(internal)?;
        }
        let running = plan.source.is_some();
        if !running {
            child.ended = Some(Instant::now());
        }
        let run = Run {
            number,
            child,
            unseen: None,
        };
        state.runs.insert(name.to_owned(), run);
        if let Some(member) = state.member(name) {
            member.place = plan.name.clone();
            member.run = RunState {
                number,
                open: true,
                running,
                place: plan.name,
                world: plan.world,
                error: None,
            };
        }
        Ok(())
    }

    /// Notes what has happened in a run; `None`: its process has ended.
    fn hear(&self, name: &str, number: u64, news: Option<RunNews>) {
        let mut state = self.change();
        let ended = match &news {
            Some(RunNews::Started) => None,
            _ => Some(Instant::now()),
        };
        match state.runs.get_mut(name) {
            Some(run) if run.number == number => run.child.ended = ended,
            _ => return,
        }
        if news.is_none() {
            state.runs.remove(name);
        }
        let Some(member) = state.member(name) else {
            return;
        };
        let was = member.run.running;
        member.run.open = news.is_some();
        member.run.running = ended.is_none();
        match news {
            Some(RunNews::Ended { error }) => {
                member.note_result(error.as_deref());
                member.run.error = error;
            }
            None if was => {
                let why = "the run has ended: it needed too much memory or time";
                member.note_result(Some(why));
                member.run.error = Some(why.to_owned());
            }
            _ => {}
        }
    }

    /// Ends a learner's script; the robot stays in its world.
    async fn stop(&self, name: &str) -> Result<(), Refusal> {
        let (socket, place) = {
            let mut state = self.state.lock();
            let run = state.runs.get(name).ok_or_else(no_run)?;
            let socket = run.child.socket();
            let member = state.member(name).ok_or_else(unknown_name)?;
            (socket, member.run.place.clone())
        };
        let request = RunRequest::Behaviour {
            name: place,
            change: Change::Stop,
            lasts: None,
        };
        let answer = ask(&socket, &request).await;
        answer.map(drop).map_err(|_| no_run())
    }

    /// A learner wants a turn on a real robot, or none any more.
    fn want_turn(&self, name: &str, wanted: bool, now: Instant) -> Result<(), Refusal> {
        let mut state = self.change();
        if wanted {
            state.allow(name, now)?;
            state.robots.queue.ask(name, now)?;
        } else {
            state.robots.queue.withdraw(name);
        }
        state.take_turns(now);
        Ok(())
    }

    /// Starts the agents of the real robots if they do not run, repeats a STOP that they have not
    /// heard, and ends and begins turns.
    fn beat(self: &Arc<Class>, now: Instant) {
        let mut state = self.state.lock();
        if state.robots.is_empty() {
            return;
        }
        state.robots.launch(now, |index, setup| {
            let class = Arc::downgrade(self);
            self.launcher.start_robot(setup, move |news| {
                if let Some(class) = class.upgrade() {
                    let mut state = class.change();
                    state.robots.hear(index, news);
                    state.take_turns(Instant::now());
                }
            })
        });
        for socket in state.robots.to_stop() {
            tokio::spawn(async move { ask(&socket, &RunRequest::Stop).await });
        }
        state.take_turns(now);
        drop(state);
        // Of turns, the pages show the time.
        self.changed.send_replace(());
    }

    /// A person's STOP of a real robot, or its release. A STOP that its agent cannot hear now holds
    /// as soon as it can.
    async fn stop_robot(self: &Arc<Class>, robot: &str, on: bool) -> Result<(), Refusal> {
        let (waited, socket) = {
            let mut state = self.change();
            let index = state.robots.queue.find(robot).ok_or_else(no_robot)?;
            let waited = state.robots.queue.stop(index, on);
            (waited, state.robots.socket(index))
        };
        if on {
            self.beat(Instant::now());
            return Ok(());
        }
        let Some(socket) = socket else {
            return if waited { Ok(()) } else { Err(no_robot()) };
        };
        let answer = ask(&socket, &RunRequest::ResetStop).await;
        match answer.map_err(internal)?.error() {
            None => Ok(()),
            Some(error) => Err(Refusal::new(StatusCode::CONFLICT, error)),
        }
    }

    /// Ends the runs that nobody needs.
    fn sweep(&self, now: Instant) {
        let mut state = self.change();
        let seen: Vec<String> = {
            let learners = state.members.learners.iter();
            let there = learners.filter(|(_, member)| member.pages > 0);
            there.map(|(name, _)| name.clone()).collect()
        };
        let teacher_is_there = state.teacher.pages > 0;
        let mut over = Vec::new();
        for (name, run) in &mut state.runs {
            let is_seen = teacher_is_there && name == TEACHER || seen.contains(name);
            run.unseen = match (is_seen, run.unseen) {
                (true, _) => None,
                (false, since) => since.or(Some(now)),
            };
            let lasts = |since: Option<Instant>, limit| since.is_some_and(|at| now - at >= limit);
            if lasts(run.child.ended, AFTER_END) || lasts(run.unseen, UNSEEN) {
                over.push(name.clone());
            }
        }
        for name in over {
            state.end_run(&name);
        }
    }

    /// Checks a learner's script, and notes points and sentence.
    async fn check(self: &Arc<Class>, name: &str, place: &str) -> Result<Value, Refusal> {
        let lesson = self.lesson(place).map(|lesson| lesson.name);
        let lesson = lesson.ok_or_else(|| not_found("only a lesson can be checked"))?;
        {
            let mut state = self.change();
            state.allow(name, Instant::now())?;
            let member = state.member(name).ok_or_else(unknown_name)?;
            if std::mem::replace(&mut member.checking, true) {
                let why = "a check is under way";
                return Err(Refusal::new(StatusCode::CONFLICT, why));
            }
        }
        let checked = self.judge(name, lesson).await;
        let check = self.note_check(name, lesson, checked)?;
        self.save().await?;
        Ok(check)
    }

    fn note_check(
        &self,
        name: &str,
        lesson: &str,
        checked: Result<Value, Refusal>,
    ) -> Result<Value, Refusal> {
        let mut state = self.change();
        let member = state.member(name).ok_or_else(unknown_name)?;
        member.checking = false;
        let mut check = checked?;
        check["lesson"] = lesson.into();
        let points = check["points"].as_u64().unwrap_or(0);
        let best = member.record.points.entry(lesson.to_owned()).or_default();
        *best = points.max(*best);
        let full = check["passed"] == true;
        let missing = check["sentence"].as_str().filter(|_| !full);
        member.note_result(missing);
        member.check = Some(check.clone());
        Ok(check)
    }

    async fn judge(self: &Arc<Class>, name: &str, lesson: &'static str) -> Result<Value, Refusal> {
        let _permit = self.checks.acquire().await.map_err(internal)?;
        let file = format!("{lesson}.lua");
        let learner = name.to_owned();
        self.block(move |class| {
            let kept = class
                .files
                .keep(&learner, &file)
                .map_err(|error| error.to_string())?;
            if kept.is_none() {
                return Ok(json!({
                    "points": 0, "max_points": POINTS, "passed": false, "scenarios": [],
                    "sentence": "There is no script yet: write one first.",
                }));
            }
            (class.tools.check)(lesson, &class.files.of(&learner).join(file))
        })
        .await
    }

    async fn save(self: &Arc<Class>) -> Result<(), Refusal> {
        let bytes = {
            let state = self.state.lock();
            serde_json::to_vec_pretty(&state.members.records())
        };
        let bytes = bytes.map_err(internal)?;
        self.block(move |class| class.files.write_records(&bytes))
            .await
    }

    /// What this caller's page shows; `None`: nothing.
    fn view(&self, caller: &Caller, now: Instant) -> Option<Value> {
        let mut state = self.state.lock();
        let name = match state.device(caller) {
            Device::Admitted(name) => name,
            Device::Waiting(name) => {
                return Some(json!({ "type": "state", "name": name, "admitted": false }));
            }
            Device::Unknown => return None,
        };
        let member = state.member(&name)?;
        let mut view = json!({
            "type": "state", "name": name, "admitted": true, "teacher": name == TEACHER,
            "place": member.place, "run": member.run, "check": member.check,
            "checking": member.checking, "edits": member.edits, "points": member.record.points,
        });
        view["frozen"] = state.frozen.into();
        view["shown"] = state.shown.into();
        view["locked"] = state.locked.into();
        view["lesson"] = state.lesson.clone().into();
        // How often the teacher's script has changed, for those who look at it.
        view["teacher_edits"] = state.teacher.edits.into();
        view["teacher_place"] = state.teacher.place.clone().into();
        view["teacher_run"] = json!(state.teacher.run);
        view["turns"] = state.robots.seen_by(&name, now);
        if *caller == Caller::Teacher {
            view["robots"] = state.robots.queue.wall(now);
            let tile = |(name, member): (&String, &Member)| member.tile(name, now);
            view["learners"] = state.members.learners.iter().map(tile).collect();
            view["waiting"] = state.members.waiting();
            view["word"] = self.word.clone().into();
            view["link"] = self.link.clone().into();
        }
        Some(view)
    }

    /// The points of all learners as CSV.
    fn points(&self) -> String {
        let state = self.state.lock();
        let lessons = self.tools.lessons.iter().map(|lesson| lesson.name);
        let mut text = format!("name,{}\n", lessons.clone().collect::<Vec<_>>().join(","));
        for (name, member) in &state.members.learners {
            let points: &BTreeMap<String, u64> = &member.record.points;
            let cell = |lesson| points.get(lesson).map_or_else(String::new, u64::to_string);
            let cells: Vec<String> = lessons.clone().map(cell).collect();
            let name = crate::sanitize::csv_cell(name);
            text += &format!("{name},{}\n", cells.join(","));
        }
        text
    }
}

impl State {
    fn end_run(&mut self, name: &str) {
        self.runs.remove(name);
        if let Some(member) = self.member(name) {
            member.run.open = false;
            member.run.running = false;
        }
    }
}
