//! What a step costs, and whether a long run costs more: the engine on a sensor that answers at once,
//! each step one durable transaction of a real database.
//!
//! ```sh
//! cargo run --release -p beampose-tests --example orchestrator -- overhead [FOLDER]
//! cargo run --release -p beampose-tests --example orchestrator -- soak 1000000 [FOLDER]
//! ```
//!
//! The folder says on which disk; without it one for temporary files is taken, which may be memory.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a measuring program stops where it cannot")]

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use async_trait::async_trait;
use beampose_core::units::Second;
use beampose_core::{
    Clock, Event, Gap, Identity, Instrument, InstrumentError, Quantity, Reading, RunSink, Sensor,
    SessionHeader, SessionId, SessionOutcome, SinkError, Stamp, StepNumber, StepRecord,
    VirtualClock,
};
use beampose_engine::{Bench, Control, Nobody, Observers, RunSummary, Surroundings};
use beampose_plan::{Action, Policy, Rules, Section, Step};
use beampose_store::Store;
use rusqlite::Connection;
use rustix::time::{ClockId, clock_gettime};
use tokio::sync::oneshot;

/// Answers at once.
struct Prompt(VirtualClock);

#[async_trait]
impl Instrument for Prompt {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        Ok(Identity { model: "prompt".to_owned(), serial: None, simulated: true })
    }
}

#[async_trait]
impl Sensor for Prompt {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let at = self.0.now();
        let value = at.monotonic.as_secs_f64();
        Ok(Reading { quantity: Quantity::Temperature, value, standard_uncertainty: None, at })
    }
}

/// Keeps nothing: what is left is the engine alone.
struct Nothing;

#[async_trait]
impl RunSink for Nothing {
    async fn open(&self, _: &SessionHeader) -> Result<(), SinkError> {
        Ok(())
    }

    async fn reopen(&self, _: SessionId, _: &Gap) -> Result<(), SinkError> {
        Ok(())
    }

    async fn step(&self, _: SessionId, _: &StepRecord) -> Result<(), SinkError> {
        Ok(())
    }

    async fn close(
        &self,
        _: SessionId,
        _: SessionOutcome,
        _: &[Event],
        _: Stamp,
    ) -> Result<(), SinkError> {
        Ok(())
    }
}

/// A store that tells how far it is.
struct Counting<'a> {
    store: &'a Store,
    steps: AtomicU64,
    marks: Mutex<Vec<Mark>>,
    every: u64,
    path: PathBuf,
}

#[derive(Debug, Clone, Copy)]
struct Mark {
    at: Instant,
    resident_mb: f64,
    database_mb: f64,
}

impl Counting<'_> {
    fn mark(&self) {
        let size = |end: &str| {
            let path = format!("{}{end}", self.path.display());
            std::fs::metadata(path).map_or(0, |meta| meta.len()) as f64
        };
        let database_mb = (size("") + size("-wal")) / 1e6;
        let mark = Mark { at: Instant::now(), resident_mb: resident_mb(), database_mb };
        self.marks.lock().unwrap().push(mark);
    }
}

#[async_trait]
impl RunSink for Counting<'_> {
    async fn open(&self, header: &SessionHeader) -> Result<(), SinkError> {
        self.store.open(header).await
    }

    async fn reopen(&self, session: SessionId, gap: &Gap) -> Result<(), SinkError> {
        self.store.reopen(session, gap).await
    }

    async fn step(&self, session: SessionId, record: &StepRecord) -> Result<(), SinkError> {
        let stored = RunSink::step(self.store, session, record).await;
        if (self.steps.fetch_add(1, Ordering::Relaxed) + 1).is_multiple_of(self.every) {
            self.mark();
        }
        stored
    }

    async fn close(
        &self,
        session: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        at: Stamp,
    ) -> Result<(), SinkError> {
        RunSink::close(self.store, session, outcome, events, at).await
    }
}

fn resident_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap_or_default();
    let kb = line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok());
    kb.unwrap_or(f64::NAN) / 1e3
}

fn cpu() -> Duration {
    let spent = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(spent.tv_sec.unsigned_abs(), u32::try_from(spent.tv_nsec).unwrap_or(0))
}

fn steps(count: u32) -> Vec<Step> {
    let step = |number| Step {
        number: StepNumber(number),
        section: Section::Main,
        context: std::collections::BTreeMap::new(),
        action: Action::Read { instruments: vec!["thermometer".into()] },
        deadline: Second(10.0),
        expected: Second(0.0),
        policy: Policy::default(),
    };
    (1..=count).map(step).collect()
}

async fn run(steps: &[Step], sink: &dyn RunSink) -> RunSummary {
    let clock = VirtualClock::starting_at(jiff::Timestamp::now());
    let mut bench = Bench::default();
    bench.sensors.insert("thermometer".into(), Arc::new(Prompt(clock.clone())));
    let (control, observers, rules) = (Control::new(), Observers::none(), Rules::default());
    let around = Surroundings {
        bench: &bench,
        sink,
        observers: &observers,
        clock: &clock,
        control: &control,
        operator: &Nobody,
        rules: &rules,
        store_patience: Duration::ZERO,
    };
    let header = SessionHeader {
        id: SessionId::fresh(),
        title: "orchestrator".to_owned(),
        experiment: "acquisition".to_owned(),
        plan_text: String::new(),
        rig_text: String::new(),
        measurement_json: "{}".to_owned(),
        files: Vec::new(),
        plan_hash: String::new(),
        origin_json: None,
        software: "measured".to_owned(),
        seed: None,
        steps: u32::try_from(steps.len()).unwrap(),
        opened: clock.now(),
    };
    let running = Box::pin(beampose_engine::run(steps, &header, &around));
    let summary = clock.drive(running).await.unwrap();
    assert_eq!(summary.outcome, SessionOutcome::Completed);
    assert_eq!(summary.steps_done, steps.len());
    summary
}

/// Wall and processor time of each of `count` things, in ms.
fn each(count: u32, wall: Duration, cpu: Duration) -> (f64, f64) {
    (wall.as_secs_f64() * 1e3 / f64::from(count), cpu.as_secs_f64() * 1e3 / f64::from(count))
}

/// A database with one table and the settings of ours: each insert is one durable transaction, on
/// the thread that asks for it.
fn raw(path: &Path) -> Connection {
    let connection = Connection::open(path).unwrap();
    connection.pragma_update(None, "journal_mode", "WAL").unwrap();
    connection.pragma_update(None, "synchronous", "FULL").unwrap();
    connection
        .execute("CREATE TABLE numbers (id INTEGER PRIMARY KEY, number INTEGER)", [])
        .unwrap();
    connection
}

fn insert(raw: &Connection, number: u32) {
    let mut insert = raw.prepare_cached("INSERT INTO numbers (number) VALUES (?)").unwrap();
    insert.execute([number]).unwrap();
}

/// The same as a program must do it that has something else to heed meanwhile.
async fn asked_of_another_thread(raw: Connection, count: u32) -> (f64, f64) {
    let (ask, asked) = std::sync::mpsc::channel::<(u32, oneshot::Sender<()>)>();
    let serving = std::thread::spawn(move || {
        for (number, done) in asked {
            insert(&raw, number);
            done.send(()).unwrap();
        }
    });
    let (begin, before) = (Instant::now(), cpu());
    for number in 0..count {
        let (done, answer) = oneshot::channel();
        ask.send((number, done)).unwrap();
        answer.await.unwrap();
    }
    let spent = each(count, begin.elapsed(), cpu() - before);
    drop(ask);
    serving.join().unwrap();
    spent
}

/// The one of the median wall time.
fn middle(mut all: Vec<(f64, f64)>) -> (f64, f64) {
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all[all.len() / 2]
}

async fn overhead(folder: &Path) {
    const STEPS: u32 = 1000;
    let plan = steps(STEPS);
    println!("| of 1,000 | ms each | ms of processor each |\n|---|---|---|");
    let (mut floors, mut asked, mut ours) = (Vec::new(), Vec::new(), Vec::new());
    for round in 0..15 {
        let store = Store::open(&folder.join(format!("steps-{round}.db"))).await.unwrap();
        let fresh = |name: &str| folder.join(format!("{name}-{round}.db"));
        let alone = raw(&fresh("alone"));
        let (begin, before) = (Instant::now(), cpu());
        (0..STEPS).for_each(|number| insert(&alone, number));
        floors.push(each(STEPS, begin.elapsed(), cpu() - before));
        asked.push(asked_of_another_thread(raw(&fresh("asked")), STEPS).await);
        let (begin, before) = (Instant::now(), cpu());
        run(&plan, &store).await;
        ours.push(each(STEPS, begin.elapsed(), cpu() - before));
        store.close().await;
    }
    let (begin, before) = (Instant::now(), cpu());
    run(&plan, &Nothing).await;
    let engine = each(STEPS, begin.elapsed(), cpu() - before);
    let (floor, asked, step) = (middle(floors), middle(asked), middle(ours));
    println!("| one SQLite FULL commit of one row | {:.3} | {:.3} |", floor.0, floor.1);
    println!("| the same, asked of another thread | {:.3} | {:.3} |", asked.0, asked.1);
    println!("| step, durable | {:.3} | {:.3} |", step.0, step.1);
    println!("| step, nothing stored | {:.4} | {:.4} |", engine.0, engine.1);
    let (alone, beside) = (step.0 / floor.0, step.0 / asked.0);
    println!(
        "\na durable step takes {alone:.2} times such a commit, {beside:.2} times one that is asked of another thread"
    );
}

async fn soak(count: u32, folder: &Path) {
    let path = folder.join("soak.db");
    let store = Store::open(&path).await.unwrap();
    let every = u64::from((count / 100).max(1));
    let (steps_done, marks) = (AtomicU64::new(0), Mutex::new(Vec::new()));
    let sink = Counting { store: &store, steps: steps_done, marks, every, path };
    let plan = steps(count);
    sink.mark();
    run(&plan, &sink).await;
    let marks = sink.marks.into_inner().unwrap();
    println!("| of the run | ms a step | resident MB | database MB |\n|---|---|---|---|");
    let tenth = |i: usize| {
        let (from, to) = (marks[10 * i], marks[10 * (i + 1)]);
        let wall = (to.at - from.at).as_secs_f64() * 1e3 / (every * 10) as f64;
        println!(
            "| {} % | {wall:.4} | {:.1} | {:.1} |",
            10 * (i + 1),
            to.resident_mb,
            to.database_mb
        );
        wall
    };
    let times: Vec<f64> = (0..10).map(tenth).collect();
    let peak = marks[1..].iter().map(|mark| mark.resident_mb).fold(0.0, f64::max);
    println!("\nmemory grew by {:.1} MB after the first hundredth", peak - marks[1].resident_mb);
    println!("the last tenth took {:.3} times the second", times[9] / times[1]);
    let (half, whole) = (marks[50].database_mb, marks[100].database_mb);
    println!("the second half of the database is {:.3} times the first", (whole - half) / half);
    store.close().await;
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let temporary = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    if let [_, folder] | [_, _, folder] = words[..] {
        std::fs::create_dir_all(folder).unwrap();
    }
    match words[..] {
        ["overhead"] => runtime.block_on(overhead(temporary.path())),
        ["overhead", folder] => runtime.block_on(overhead(Path::new(folder))),
        ["soak", count] => runtime.block_on(soak(count.parse().unwrap(), temporary.path())),
        ["soak", count, folder] => {
            runtime.block_on(soak(count.parse().unwrap(), Path::new(folder)));
        }
        _ => panic!("overhead [FOLDER] | soak STEPS [FOLDER]"),
    }
}
