//! What is stored of a session comes back, or is refused.

use beampose_core::{
    Answer, EventKind, Gap, Look, Missing, RunSink, SessionId, SessionOutcome, StepNumber,
    StepOutcome, StepRecord,
};

use super::{at, event, fresh, header, p000, picture, session, step};
use crate::{Store, StoreError};

#[tokio::test]
async fn a_session_comes_back_as_it_was_stored() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    let stored = store.session(id).await.unwrap();
    assert_eq!(stored.header, header(id));
    assert_eq!(stored.closed, Some(at(9000)));
    assert_eq!(stored.outcome, Some(SessionOutcome::Completed));

    let steps = store.steps(id).await.unwrap();
    assert_eq!(steps.len(), 2);
    assert_eq!(steps[0].label, "capture p000");
    assert_eq!((steps[0].started, steps[0].finished), (at(1000), at(3000)));

    let record = step(1, "p000", Vec::new());
    let readings = store.readings(id).await.unwrap();
    assert_eq!(readings[0].reading, record.readings[0].1);
    assert_eq!(readings[0].instrument, record.readings[0].0);

    let events = store.events(id).await.unwrap();
    assert_eq!(events[0].event, record.events[0]);
    assert_eq!(events[0].step, Some(StepNumber(1)));
    assert_eq!((events[2].step, events[2].event.kind), (None, EventKind::Closed));
}

#[tokio::test]
async fn captures_and_pictures_come_back_as_they_were_stored() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    let captures = store.captures(id).await.unwrap();
    let record = step(1, "p000", Vec::new()).capture.unwrap();
    assert_eq!(captures[0].setpoints, record.setpoints);
    assert_eq!(captures[0].readings, record.readings);
    assert_eq!(captures[0].triggered, at(1500));
    let cameras: Vec<_> = captures[0].pictures.iter().map(|it| it.camera.as_str()).collect();
    assert_eq!(cameras, ["cam_a", "cam_b"]);
    assert_eq!(captures[0].pictures[1].size_bytes, 4);
    assert_eq!(store.picture(id, &p000(), &"cam_b".into()).await.unwrap(), b"dots");
    let missing = store.picture(id, &p000(), &"cam_z".into()).await.unwrap_err();
    assert!(matches!(missing, StoreError::NotFound { .. }));
}

#[tokio::test]
async fn the_list_of_sessions_counts() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let first = session(store).await;
    let running = SessionId::fresh();
    store.open(&header(running)).await.unwrap();
    let list = store.sessions().await.unwrap();
    let counts: Vec<_> = list
        .iter()
        .map(|it| (it.id, it.outcome, it.steps_stored, it.captures, it.solved))
        .collect();
    let closed = Some(SessionOutcome::Completed);
    assert_eq!(counts, [(first, closed, 2, 2, 0), (running, None, 0, 0, 0)]);
    assert!(list[0].simulated);
}

#[tokio::test]
async fn identical_pictures_are_stored_once() {
    let fresh = fresh().await;
    session(&fresh.store).await;
    let blobs: i64 = sqlx::query_scalar("SELECT count(*) FROM blobs")
        .fetch_one(&fresh.store.readers)
        .await
        .unwrap();
    assert_eq!(blobs, 2);
}

#[tokio::test]
async fn a_step_is_stored_whole_or_not_at_all() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = SessionId::fresh();
    store.open(&header(id)).await.unwrap();
    // The second picture of one camera breaks a rule after much of the step is written.
    let twice = vec![picture("cam_a", b"wall"), picture("cam_a", b"dots")];
    let error = store.step(id, &step(1, "p000", twice)).await.unwrap_err();
    assert!(error.to_string().contains("step 1 of session"), "{error}");
    assert!(store.steps(id).await.unwrap().is_empty());
    assert!(store.readings(id).await.unwrap().is_empty());
    store.step(id, &step(1, "p000", vec![picture("cam_a", b"wall")])).await.unwrap();
}

#[tokio::test]
async fn what_is_stored_is_not_overwritten() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    let again = store.step(id, &step(1, "p009", Vec::new())).await.unwrap_err();
    assert!(again.reason.contains("step 1 of this session is stored already"), "{again}");
    let closed = RunSink::close(store, id, SessionOutcome::Error, &[], at(9)).await.unwrap_err();
    assert!(closed.reason.contains("no open session"), "{closed}");
    assert_eq!(store.session(id).await.unwrap().outcome, Some(SessionOutcome::Completed));
}

#[tokio::test]
async fn a_setpoint_that_is_no_number_is_refused() {
    let fresh = fresh().await;
    let id = SessionId::fresh();
    fresh.store.open(&header(id)).await.unwrap();
    let mut record = step(1, "p000", Vec::new());
    record.capture.as_mut().unwrap().setpoints.insert("rail_mm".to_owned(), f64::NAN);
    let error = fresh.store.step(id, &record).await.unwrap_err();
    assert!(error.reason.contains("rail_mm is NaN"), "{error}");
}

#[tokio::test]
async fn a_failed_step_keeps_its_reason() {
    let fresh = fresh().await;
    let id = SessionId::fresh();
    fresh.store.open(&header(id)).await.unwrap();
    let mut record = step(1, "p000", Vec::new());
    record.outcome = StepOutcome::Failed { reason: "cam_a: no answer within 5s".to_owned() };
    fresh.store.step(id, &record).await.unwrap();
    assert_eq!(fresh.store.steps(id).await.unwrap()[0].outcome, record.outcome);
}

#[tokio::test]
async fn what_policies_and_people_left_comes_back() {
    let fresh = fresh().await;
    let id = SessionId::fresh();
    fresh.store.open(&header(id)).await.unwrap();
    let mut record = step(1, "p000", Vec::new());
    let missing = Missing { instrument: "cam_b".into(), reason: "no answer within 5s".to_owned() };
    record.missing = vec![missing.clone()];
    fresh.store.step(id, &record).await.unwrap();
    let mut record = step(2, "p001", Vec::new());
    record.outcome = StepOutcome::PassedOver { reason: "wavemeter: no light".to_owned() };
    let answer = Answer {
        name: "fixture".to_owned(),
        value: "'); DROP TABLE answers; --".to_owned(),
        by: "terminal".to_owned(),
    };
    record.answer = Some(answer.clone());
    let look = |read: f64, dot_px| Look { at: at(1500), commanded: 3.0, read, dot_px };
    record.looks = vec![look(3.0001, None), look(2.9999, Some([319.5, 240.25]))];
    let looks: Vec<_> = record.looks.iter().map(|look| (StepNumber(2), *look)).collect();
    fresh.store.step(id, &record).await.unwrap();
    RunSink::close(&fresh.store, id, SessionOutcome::Halted, &[], at(9)).await.unwrap();
    assert_eq!(fresh.store.missing(id).await.unwrap(), [(StepNumber(1), missing)]);
    assert_eq!(fresh.store.answers(id).await.unwrap(), [(StepNumber(2), answer)]);
    assert_eq!(fresh.store.looks(id).await.unwrap(), looks);
    assert_eq!(fresh.store.steps(id).await.unwrap()[1].outcome, record.outcome);
    assert_eq!(fresh.store.session(id).await.unwrap().outcome, Some(SessionOutcome::Halted));
    assert_eq!(fresh.store.sessions().await.unwrap()[0].outcome, Some(SessionOutcome::Halted));
}

#[tokio::test]
async fn every_kind_of_event_comes_back() {
    let fresh = fresh().await;
    let id = SessionId::fresh();
    fresh.store.open(&header(id)).await.unwrap();
    let kinds = [
        EventKind::Opened,
        EventKind::Identified,
        EventKind::LaserOn,
        EventKind::LaserOff,
        EventKind::LaserUnknown,
        EventKind::Moved,
        EventKind::AbortRequested,
        EventKind::StepFailed,
        EventKind::Closed,
    ];
    let events: Vec<_> = kinds.iter().map(|kind| event(*kind, "it happened")).collect();
    RunSink::close(&fresh.store, id, SessionOutcome::Aborted, &events, at(9)).await.unwrap();
    let stored = fresh.store.events(id).await.unwrap();
    assert_eq!(stored.iter().map(|it| it.event.clone()).collect::<Vec<_>>(), events);
}

/// Sessions with these ids, in this order.
async fn sessions(store: &Store, ids: &[&str]) {
    for id in ids {
        store.open(&header(SessionId(id.parse().unwrap()))).await.unwrap();
    }
}

const FIRST: &str = "0195a000-0000-7000-8000-000000000001";
const SECOND: &str = "0195b000-0000-7000-8000-000000000002";

#[tokio::test]
async fn a_session_is_found_by_id_unique_beginning_and_latest() {
    let fresh = fresh().await;
    // The newest has the smaller id: `latest` goes by the order in which they were made.
    sessions(&fresh.store, &[SECOND, FIRST]).await;
    for (wanted, found) in
        [(FIRST, FIRST), ("0195a", FIRST), ("0195B", SECOND), (" latest ", FIRST)]
    {
        let id = fresh.store.find_session(wanted).await.unwrap();
        assert_eq!(id.to_string(), found, "{wanted:?}");
    }
}

#[tokio::test]
async fn an_ambiguous_beginning_lists_the_candidates() {
    let fresh = fresh().await;
    sessions(&fresh.store, &[FIRST, SECOND]).await;
    let error = fresh.store.find_session("0195").await.unwrap_err().to_string();
    let expected =
        format!("\"0195\" fits 2 sessions:\n  {FIRST}  rail test\n  {SECOND}  rail test");
    assert_eq!(error, expected);
}

#[tokio::test]
async fn an_unknown_beginning_names_the_nearest() {
    let fresh = fresh().await;
    let error = fresh.store.find_session("latest").await.unwrap_err().to_string();
    assert_eq!(error, "there is no session in this database yet");
    sessions(&fresh.store, &[FIRST, SECOND]).await;
    let error = fresh.store.find_session("0196a").await.unwrap_err();
    let StoreError::NotFound { nearest, .. } = error else { panic!("{error}") };
    assert_eq!(nearest[0], format!("{FIRST}  rail test"));
    assert!(fresh.store.find_session("").await.is_err());
}

#[tokio::test]
async fn a_sound_session_verifies() {
    let fresh = fresh().await;
    let id = session(&fresh.store).await;
    let found = fresh.store.verify(id).await.unwrap();
    assert!(found.is_sound(), "{:?}", found.problems);
    assert_eq!((found.pictures, found.bytes), (3, 12));
}

#[tokio::test]
async fn a_corrupt_picture_is_detected_and_never_given_out() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    sqlx::query("UPDATE blobs SET bytes = x'646f7473ff' WHERE bytes = CAST('dots' AS BLOB)")
        .execute(&mut *store.writer.turn("test").await.unwrap())
        .await
        .unwrap();
    let error = store.picture(id, &p000(), &"cam_b".into()).await.unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, StoreError::Damaged { .. }));
    let start =
        format!("the picture of cam_b in capture p000 of session {id} is damaged: its BLAKE3");
    assert!(text.starts_with(&start), "{text}");
    assert_eq!(store.verify(id).await.unwrap().problems, [text]);
}

#[tokio::test]
async fn a_missing_picture_is_detected() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    let mut connection = store.writer.turn("test").await.unwrap();
    for sql in ["PRAGMA foreign_keys = OFF", "DELETE FROM blobs WHERE id = 1"] {
        sqlx::query(sql).execute(&mut *connection).await.unwrap();
    }
    let problems = store.verify(id).await.unwrap().problems;
    assert_eq!(problems.len(), 3, "{problems:?}");
    assert!(problems[0].ends_with("its bytes are missing"), "{problems:?}");
    assert!(problems[2].ends_with("pictures -> blobs"), "{problems:?}");
}

#[tokio::test]
async fn a_session_goes_on_and_keeps_what_is_done_again_as_an_earlier_attempt() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = SessionId::fresh();
    store.open(&header(id)).await.unwrap();
    let first = vec![picture("cam_a", b"first")];
    store.step(id, &step(1, "p000", first)).await.unwrap();
    let outcome = StepOutcome::Failed { reason: "cam_b: no answer".to_owned() };
    let partial = vec![picture("cam_a", b"partial")];
    let failed = StepRecord { outcome, ..step(2, "p001", partial) };
    store.step(id, &failed).await.unwrap();
    RunSink::close(store, id, SessionOutcome::Error, &[], at(3100)).await.unwrap();
    let gap = Gap {
        stopped: at(3100),
        resumed: at(9000),
        reason: "error".to_owned(),
        redone: vec![StepNumber(2)],
        restored: vec!["move rail to 100 mm".to_owned()],
    };
    store.reopen(id, &gap).await.unwrap();
    assert_eq!(store.session(id).await.unwrap().outcome, None);
    assert_eq!(store.gaps(id).await.unwrap(), [gap]);
    // What is done stays done; what is done again may be stored once more, and only once.
    assert!(store.step(id, &step(1, "p000", Vec::new())).await.is_err());
    let whole = || StepRecord {
        finished: at(9500),
        ..step(2, "p001", vec![picture("cam_a", b"again"), picture("cam_b", b"other")])
    };
    store.step(id, &whole()).await.unwrap();
    assert!(store.step(id, &whole()).await.is_err());
    let captures = store.captures(id).await.unwrap();
    let pictures: Vec<usize> = captures.iter().map(|c| c.pictures.len()).collect();
    assert_eq!(pictures, [1, 2]);
    let steps = store.steps(id).await.unwrap();
    assert!(steps.iter().all(|step| step.outcome == StepOutcome::Done));
    // The picture of the earlier attempt is still there, by the name in its record.
    let kept: String = sqlx::query_scalar(
        "SELECT json_extract(capture_json, '$.pictures[0].blake3') FROM attempts WHERE step = 2",
    )
    .fetch_one(&store.readers)
    .await
    .unwrap();
    assert_eq!(kept, blake3::hash(b"partial").to_hex().as_str());
    let blobs: i64 = sqlx::query_scalar("SELECT count(*) FROM blobs WHERE blake3 = ?")
        .bind(kept)
        .fetch_one(&store.readers)
        .await
        .unwrap();
    assert_eq!(blobs, 1);
    assert_eq!(store.verify(id).await.unwrap().problems, Vec::<String>::new());
}
