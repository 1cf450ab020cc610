//! Sessions in the long run: labels, verification, deletion.

use beampose_core::{
    Answer, Gap, Look, Missing, RunSink, SessionId, SessionOutcome, StepNumber, StepOutcome,
    StepRecord,
};

use super::opening::stranger;
use super::solving::solve;
use super::{at, fresh, header, p000, picture, session, step};
use crate::{Note, ResultRow, Store, StoreError, truth};

fn noon() -> jiff::Timestamp {
    "2026-03-02T12:00:00Z".parse().unwrap()
}

#[tokio::test]
async fn tags_are_set_once_and_taken_off() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    assert!(store.tag(id, "warm", noon()).await.unwrap());
    assert!(store.tag(id, " baseline ", noon()).await.unwrap());
    assert!(!store.tag(id, "warm", noon()).await.unwrap(), "it has it already");
    assert_eq!(store.tags(id).await.unwrap(), ["baseline", "warm"]);
    assert_eq!(store.sessions().await.unwrap()[0].tags, ["baseline", "warm"]);
    assert!(store.untag(id, "warm").await.unwrap());
    assert!(!store.untag(id, "warm").await.unwrap());
    assert_eq!(store.tags(id).await.unwrap(), ["baseline"]);
}

#[tokio::test]
async fn what_is_no_tag_is_refused() {
    let fresh = fresh().await;
    let id = session(&fresh.store).await;
    let long = "x".repeat(65);
    for tag in ["", "  ", "two words", "a,b", "bell\u{7}", &long] {
        let error = fresh.store.tag(id, tag, noon()).await.unwrap_err();
        assert!(matches!(error, StoreError::Refused { .. }), "{tag:?}: {error}");
    }
    let nobody = fresh.store.tag(SessionId::fresh(), "warm", noon()).await.unwrap_err();
    assert!(matches!(nobody, StoreError::Refused { .. }), "{nobody}");
}

#[tokio::test]
async fn notes_are_dated_and_stay_in_order() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    let notes = ["lamp was on", "O'Brien; DROP TABLE notes"].map(str::to_owned);
    for text in &notes {
        let note = Note { written: noon(), text: text.clone() };
        store.add_note(id, &note).await.unwrap();
    }
    let stored = store.notes(id).await.unwrap();
    assert_eq!(stored.iter().map(|n| n.text.clone()).collect::<Vec<_>>(), notes);
    assert!(stored.iter().all(|note| note.written == noon()));
    let empty = Note { written: noon(), text: " \n".to_owned() };
    assert!(store.add_note(id, &empty).await.is_err());
}

/// Every row of every table, as text: to see that something did not change.
async fn everything(store: &Store) -> Vec<String> {
    let mut connection = store.readers.acquire().await.unwrap();
    let mut all = Vec::new();
    for table in crate::tables::session_tables(&mut connection, "main").await.unwrap() {
        let columns: Vec<String> =
            table.columns.iter().map(|c| format!("quote(\"{}\")", c.name)).collect();
        let sql = format!("SELECT {} FROM {}", columns.join("||' '||"), table.name);
        let rows: Vec<String> =
            sqlx::query_scalar(sqlx::AssertSqlSafe(sql)).fetch_all(&mut *connection).await.unwrap();
        all.extend(rows.into_iter().map(|row| format!("{} {row}", table.name)));
    }
    all.sort();
    all
}

async fn count(store: &Store, sql: &'static str) -> i64 {
    sqlx::query_scalar(sql).fetch_one(&store.readers).await.unwrap()
}

/// A session with something in every table, and a picture that the others have too (`wall`).
pub(super) async fn full_session(store: &Store) -> SessionId {
    let id = SessionId::fresh();
    let fan = super::calibrations::fan(id);
    let with_origin = beampose_core::SessionHeader {
        origin_json: Some("{\"plan\":\"plan.yaml\"}".to_owned()),
        files: vec![super::used(None, &fan.content), super::used(Some("cam_a"), "camera")],
        ..header(id)
    };
    store.open(&with_origin).await.unwrap();
    // It was made from this session too: both ways to it are then in the tables.
    assert!(store.record_calibration(&fan).await.unwrap());
    let own = format!("own {id}");
    let first = vec![picture("cam_a", b"wall"), picture("cam_b", own.as_bytes())];
    let mut first = step(1, "p000", first);
    let reason = "no answer within 5s".to_owned();
    first.missing = vec![Missing { instrument: "cam_c".into(), reason }];
    let (name, value) = ("fixture".to_owned(), "rolled".to_owned());
    first.looks =
        vec![Look { at: at(1500), commanded: 3.0, read: 3.0001, dot_px: Some([320.0, 240.5]) }];
    first.answer = Some(Answer { name, value, by: "terminal".to_owned() });
    store.step(id, &first).await.unwrap();
    let tried = format!("partial {id}");
    let outcome = StepOutcome::Failed { reason: "cam_b: no answer".to_owned() };
    let failed =
        StepRecord { outcome, ..step(2, "p001", vec![picture("cam_a", tried.as_bytes())]) };
    store.step(id, &failed).await.unwrap();
    let gap = Gap {
        stopped: at(3100),
        resumed: at(9000),
        reason: "error".to_owned(),
        redone: vec![StepNumber(2)],
        restored: vec!["move rail to 100 mm".to_owned()],
    };
    store.reopen(id, &gap).await.unwrap();
    let again = vec![picture("cam_a", b"wall")];
    let again = StepRecord { finished: at(9500), ..step(2, "p001", again) };
    store.step(id, &again).await.unwrap();
    let end = [super::event(beampose_core::EventKind::Closed, "session closed: completed")];
    RunSink::close(store, id, SessionOutcome::Completed, &end, at(9900)).await.unwrap();
    let processing = solve(store, id).await;
    let second = solve(store, id).await;
    for (processing, verdict) in [(processing, "pass"), (second, "fail")] {
        let result_json = super::views::result(verdict);
        let result = ResultRow { processing, created: noon(), result_json };
        store.save_result(&result).await.unwrap();
    }
    truth::save_capture(store, id, &p000(), "{\"x_mm\":12.5}").await.unwrap();
    truth::save_parameters(store, id, "{\"k1\":3.5e-8}").await.unwrap();
    store.tag(id, "warm", noon()).await.unwrap();
    store.add_note(id, &Note { written: noon(), text: "lamp was on".to_owned() }).await.unwrap();
    id
}

#[tokio::test]
async fn every_table_belongs_to_sessions_or_is_known_to_be_shared() {
    let fresh = fresh().await;
    let id = full_session(&fresh.store).await;
    let mut connection = fresh.store.readers.acquire().await.unwrap();
    let tables = crate::tables::session_tables(&mut connection, "main").await.unwrap();
    let names: Vec<&str> = tables.iter().map(|table| table.name.as_str()).collect();
    let all: Vec<String> = sqlx::query_scalar(
        "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite%'
            AND name <> '_sqlx_migrations'",
    )
    .fetch_all(&mut *connection)
    .await
    .unwrap();
    let shared: Vec<&String> = all.iter().filter(|name| !names.contains(&name.as_str())).collect();
    let known = ["blobs", "calibrations", "calibration_sources"];
    assert_eq!(shared, known, "deletion, export and import would pass these over");
    // Row numbers are followed along references, over two tables too.
    let numbers = |table: &str, column: &str| {
        let table = tables.iter().find(|t| t.name == table).unwrap();
        table.columns.iter().find(|c| c.name == column).unwrap().numbers.clone()
    };
    assert_eq!(numbers("poses", "processing").as_deref(), Some("processings"));
    assert_eq!(numbers("attempts", "gap").as_deref(), Some("gaps"));
    assert_eq!(numbers("results", "id").as_deref(), Some("results"));
    assert_eq!(numbers("steps", "number"), None);
    for table in &tables {
        let sql =
            format!("SELECT count(*) FROM {} t WHERE {}", table.name, table.owned("main", "t"));
        let rows: i64 = sqlx::query_scalar(sqlx::AssertSqlSafe(sql))
            .bind(id.to_string())
            .fetch_one(&mut *connection)
            .await
            .unwrap();
        assert!(rows > 0, "full_session has nothing in {}: deletion is not tested", table.name);
    }
}

#[tokio::test]
async fn a_deleted_session_is_gone_and_the_others_are_as_they_were() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let kept = [full_session(store).await, session(store).await];
    let before = everything(store).await;
    let blobs = count(store, "SELECT count(*) FROM blobs").await;
    let gone = full_session(store).await;
    let deleted = store.delete_session(gone).await.unwrap();
    // Its own picture and that of the earlier attempt; `wall` is also the others'.
    assert_eq!(deleted.pictures, 2);
    assert_eq!(deleted.bytes, 4 + 36 + 8 + 36);
    assert_eq!(everything(store).await, before);
    assert_eq!(count(store, "SELECT count(*) FROM blobs").await, blobs);
    for id in kept {
        assert_eq!(store.verify(id).await.unwrap().problems, Vec::<String>::new());
    }
    let again = store.delete_session(gone).await.unwrap_err();
    assert!(matches!(again, StoreError::NotFound { .. }), "{again}");
}

#[tokio::test]
async fn vacuum_gives_back_what_deletion_left() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let kept = session(store).await;
    let big = SessionId::fresh();
    store.open(&header(big)).await.unwrap();
    let mut state = 1_u32;
    let noise: Vec<u8> = std::iter::repeat_with(|| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    })
    .take(400_000)
    .collect();
    store.step(big, &step(1, "p000", vec![picture("cam_a", &noise)])).await.unwrap();
    store.delete_session(big).await.unwrap();
    let free = count(store, "SELECT freelist_count FROM pragma_freelist_count").await as u64;
    let page = count(store, "SELECT page_size FROM pragma_page_size").await as u64;
    assert!(free * page > 350_000, "{free} pages");
    let (before, after) = store.vacuum().await.unwrap();
    assert!(before - after >= free * page, "{before} -> {after}, {free} pages were free");
    assert_eq!(after, std::fs::metadata(store.path()).unwrap().len());
    assert!(store.verify(kept).await.unwrap().is_sound());
}

#[tokio::test]
async fn a_step_that_left_no_record_is_found() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let told = async |outcome: SessionOutcome, numbers: &[u32]| {
        let id = SessionId::fresh();
        let planned = beampose_core::SessionHeader { steps: 6, ..header(id) };
        store.open(&planned).await.unwrap();
        for number in numbers {
            let capture = format!("p{number:03}");
            let record = step(*number, &capture, vec![picture("cam_a", b"wall")]);
            store.step(id, &record).await.unwrap();
        }
        RunSink::close(store, id, outcome, &[], at(9000)).await.unwrap();
        store.verify(id).await.unwrap().problems
    };
    let none = Vec::<String>::new();
    assert_eq!(told(SessionOutcome::Completed, &[1, 2, 3, 4, 5, 6]).await, none);
    let problems = told(SessionOutcome::Completed, &[1, 2, 5, 6]).await;
    assert_eq!(problems, ["steps 3 to 4 of 6 left no record"]);
    let problems = told(SessionOutcome::Completed, &[1, 2, 3, 4, 5]).await;
    assert_eq!(problems, ["step 6 of 6 left no record"]);
    // Stopped behind step 2, and `finally` is 5 and 6.
    assert_eq!(told(SessionOutcome::Aborted, &[1, 2, 5, 6]).await, none);
    let problems = told(SessionOutcome::Aborted, &[1, 3, 5, 6]).await;
    assert_eq!(problems, ["step 4 of 6 left no record"]);
    let problems = told(SessionOutcome::Error, &[1, 7]).await;
    assert_eq!(problems, ["step 7 is stored, the plan has 6"]);
}

#[tokio::test]
async fn a_capture_or_an_input_that_is_not_what_it_was_is_found() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = full_session(store).await;
    let honest = blake3::hash(header(id).measurement_json.as_bytes()).to_hex();
    let set = async |lineage: String| {
        let update = sqlx::query("UPDATE processings SET lineage_json = ?").bind(lineage);
        update.execute(&mut *store.writer.turn("test").await.unwrap()).await
    };
    set(format!("{{\"measurement_blake3\":\"{honest}\"}}")).await.unwrap();
    assert_eq!(store.verify(id).await.unwrap().problems, Vec::<String>::new());
    set("{\"measurement_blake3\":\"00ff\"}".to_owned()).await.unwrap();
    let problems = store.verify(id).await.unwrap().problems;
    assert_eq!(problems.len(), 2, "{problems:?}");
    assert!(problems[0].starts_with("the calibrations, pattern and artefact of processing 1"));
    sqlx::query("UPDATE blobs SET bytes = x'00' WHERE CAST(bytes AS TEXT) LIKE 'partial%'")
        .execute(&mut *store.writer.turn("test").await.unwrap())
        .await
        .unwrap();
    let problems = store.verify(id).await.unwrap().problems;
    let expected = "the picture of cam_a in an earlier attempt at step 2 is damaged";
    assert_eq!(problems[0], expected);
}

#[tokio::test]
async fn attempts_come_back_with_their_gap() {
    let fresh = fresh().await;
    let id = full_session(&fresh.store).await;
    let attempts = fresh.store.attempts(id).await.unwrap();
    assert_eq!(attempts.len(), 1);
    assert_eq!((attempts[0].gap, attempts[0].step.number), (0, StepNumber(2)));
    assert!(attempts[0].captured);
    let StepOutcome::Failed { reason } = &attempts[0].step.outcome else { panic!("{attempts:?}") };
    assert_eq!(reason, "cam_b: no answer");
}

#[tokio::test]
async fn a_database_that_is_held_says_so_and_takes_the_same_again_later() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = full_session(store).await;
    sqlx::query("PRAGMA busy_timeout = 1")
        .execute(&mut *store.writer.turn("test").await.unwrap())
        .await
        .unwrap();
    let mut other = stranger(store.path()).await;
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    let what = "the database is held by another program; try again when it has finished";
    let held = [
        (store.tag(id, "cold", noon()).await.map(|_| ()).unwrap_err(), "tag a session"),
        (store.delete_session(id).await.map(|_| ()).unwrap_err(), "delete a session"),
    ];
    for (error, doing) in held {
        assert_eq!(error.to_string(), format!("failed to {doing}: {what}"));
    }
    // Who only reads is not held up.
    assert!(store.verify(id).await.unwrap().is_sound());
    sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    assert!(store.tag(id, "cold", noon()).await.unwrap());
    store.delete_session(id).await.unwrap();
}
