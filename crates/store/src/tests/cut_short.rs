//! After a power cut: the write-ahead log ends in the middle, or in what never reached the disk; a
//! page of the file was half written. What is left is whole, and the session goes on behind it.

use std::path::Path;

use beampose_core::{Gap, RunSink, SessionHeader, SessionId, StepNumber, StepOutcome, StepRecord};

use super::{at, fresh, header, picture, step};
use crate::Store;

/// Steps stored, of so many planned.
const STEPS: u32 = 6;
const PLANNED: u32 = 8;
/// Bytes of the log's header, and of a frame's
/// (<https://www.sqlite.org/fileformat.html>, section 4.1).
const LOG_HEADER: usize = 32;
const FRAME_HEADER: usize = 24;
const PAGE: usize = 4096;

fn record(number: u32) -> StepRecord {
    // Larger than a page, so that each step takes several frames.
    let bytes = |camera: &str| format!("{camera} {number} ").repeat(900).into_bytes();
    let pictures = ["cam_a", "cam_b"].map(|camera| picture(camera, &bytes(camera)));
    let times = (at(u64::from(number) * 10_000), at(u64::from(number) * 10_000 + 5000));
    let whole = step(number, &format!("p{number:03}"), pictures.into());
    StepRecord { started: times.0, finished: times.1, ..whole }
}

/// A database with a session under way, as a power cut finds it: the file, and the log beside it.
struct Cut {
    session: SessionId,
    file: Vec<u8>,
    log: Vec<u8>,
}

async fn cut() -> Cut {
    let fresh = fresh().await;
    let session = SessionId::fresh();
    let planned = SessionHeader { steps: PLANNED, ..header(session) };
    fresh.store.open(&planned).await.unwrap();
    for number in 1..=STEPS {
        fresh.store.step(session, &record(number)).await.unwrap();
    }
    let read =
        |ending: &str| std::fs::read(format!("{}{ending}", fresh.store.path().display())).unwrap();
    let cut = Cut { session, file: read(""), log: read("-wal") };
    assert!(cut.log.len() > LOG_HEADER + 20 * (FRAME_HEADER + PAGE), "{}", cut.log.len());
    cut
}

/// Opens such a file and log; how many steps are left of the session, `None` where there is none.
/// What is left is checked, gone on with to the end, and checked again.
async fn left(cut: &Cut, file: &[u8], log: &[u8], what: &str) -> Option<u32> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("beampose.db");
    std::fs::write(&path, file).unwrap();
    std::fs::write(folder.path().join("beampose.db-wal"), log).unwrap();
    let count = opened(cut, &path, what).await;
    if let Some(count) = count {
        go_on(cut, &path, count, what).await;
    }
    count
}

async fn opened(cut: &Cut, path: &Path, what: &str) -> Option<u32> {
    let store = Store::open(path).await.unwrap();
    assert_eq!(store.verify_file().await.unwrap(), Vec::<String>::new(), "{what}");
    if store.sessions().await.unwrap().is_empty() {
        return None;
    }
    whole(&store, cut.session, what).await;
    let count = store.steps(cut.session).await.unwrap().len();
    store.close().await;
    Some(u32::try_from(count).unwrap())
}

/// Every step that is there is there with all that it acquired, and none is missing before it.
async fn whole(store: &Store, session: SessionId, what: &str) {
    let steps = store.steps(session).await.unwrap();
    let captures = store.captures(session).await.unwrap();
    let readings = store.readings(session).await.unwrap();
    let events = store.events(session).await.unwrap();
    let counts = [captures.len(), readings.len(), events.len()];
    assert_eq!(counts, [steps.len(); 3], "{what}");
    for (number, (step, capture)) in (1..).zip(steps.iter().zip(&captures)) {
        assert_eq!((step.number.0, capture.step.0), (number, number), "{what}");
        assert_eq!(step.outcome, StepOutcome::Done, "{what}");
        assert_eq!(capture.pictures.len(), 2, "{what}");
    }
    let found = store.verify(session).await.unwrap();
    assert_eq!(found.problems, Vec::<String>::new(), "{what}");
    assert_eq!(found.pictures, 2 * steps.len() as u64, "{what}");
}

async fn go_on(cut: &Cut, path: &Path, count: u32, what: &str) {
    let store = Store::open(path).await.unwrap();
    let gap = Gap {
        stopped: at(u64::from(count) * 10_000 + 5000),
        resumed: at(500_000),
        reason: "the program died".to_owned(),
        redone: Vec::new(),
        restored: Vec::new(),
    };
    store.reopen(cut.session, &gap).await.unwrap();
    for number in count + 1..=PLANNED {
        store.step(cut.session, &record(number)).await.unwrap();
    }
    whole(&store, cut.session, what).await;
    let steps = store.steps(cut.session).await.unwrap();
    assert_eq!(steps.last().unwrap().number, StepNumber(PLANNED), "{what}");
    store.close().await;
}

/// Places in the log: around the ends of its frames, and within them.
fn places(log: &[u8]) -> Vec<usize> {
    let frame = FRAME_HEADER + PAGE;
    let mut places = vec![0, 1, LOG_HEADER - 1, LOG_HEADER];
    for begin in (LOG_HEADER..log.len()).step_by(frame) {
        places.extend([begin + 7, begin + FRAME_HEADER + 1, begin + frame / 2, begin + frame]);
    }
    places.retain(|place| *place <= log.len());
    places
}

#[tokio::test(flavor = "multi_thread")]
async fn a_truncated_log_leaves_whole_steps_and_the_session_goes_on() {
    let cut = cut().await;
    let mut counts = Vec::new();
    for place in places(&cut.log) {
        let what = format!("log of {} bytes cut at {place}", cut.log.len());
        counts.push(left(&cut, &cut.file, &cut.log[..place], &what).await);
    }
    println!("{} places", counts.len());
    assert!(counts.is_sorted(), "a longer log never holds less: {counts:?}");
    // Each number of steps is met, from none to all: the cuts are fine enough to tell.
    counts.dedup();
    let expected: Vec<Option<u32>> = [None].into_iter().chain((0..=STEPS).map(Some)).collect();
    assert_eq!(counts, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_log_that_ends_in_what_never_was_written_leaves_whole_steps() {
    let cut = cut().await;
    let mut counts = Vec::new();
    for (i, place) in places(&cut.log).into_iter().step_by(3).enumerate() {
        let mut log = cut.log.clone();
        let end = (place + 512).min(log.len());
        // A sector of zeros, or of something else; what follows it is as it was meant to be.
        let sector = [0_u8, 0xa5][i % 2];
        log[place..end].fill(sector);
        if log == cut.log {
            continue;
        }
        let what = format!("log of {} bytes, {sector:#x} from {place}", log.len());
        counts.push(left(&cut, &cut.file, &log, &what).await);
    }
    println!("{} places", counts.len());
    counts.dedup();
    assert!(counts.is_sorted(), "{counts:?}");
    assert_eq!(counts.last(), Some(&Some(STEPS - 1)), "the last commit is hurt by any of them");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_half_written_while_the_log_was_folded_in_is_made_whole_from_the_log() {
    let cut = cut().await;
    let frames = cut.log[LOG_HEADER..].chunks_exact(FRAME_HEADER + PAGE);
    let mut pages: Vec<usize> =
        frames.map(|frame| u32::from_be_bytes(frame[..4].try_into().unwrap()) as usize).collect();
    pages.sort_unstable();
    pages.dedup();
    assert!(pages.len() > 10);
    let torn = |file: &mut Vec<u8>, page: usize| {
        let half = (page - 1) * PAGE + PAGE / 2;
        file.resize(file.len().max(half + PAGE / 2), 0);
        file[half..half + PAGE / 2].fill(0x5a);
    };
    let mut all = cut.file.clone();
    for page in &pages {
        let mut one = cut.file.clone();
        torn(&mut one, *page);
        torn(&mut all, *page);
        let what = format!("page {page} torn");
        assert_eq!(left(&cut, &one, &cut.log, &what).await, Some(STEPS), "{what}");
    }
    assert_eq!(left(&cut, &all, &cut.log, "all pages torn").await, Some(STEPS));
    // Without the log that is damage, and found: the test is about something.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("beampose.db");
    std::fs::write(&path, &all).unwrap();
    let store = Store::open(&path).await;
    let noticed = match store {
        Ok(store) => store.verify_file().await.map_or(true, |problems| !problems.is_empty()),
        Err(_) => true,
    };
    assert!(noticed);
}
