//! The connection that writes a run's steps.

use std::task::Poll;
use std::time::Duration;

use beampose_core::{RunSink, SessionHeader, SessionId};

use super::opening::stranger;
use super::{at, fresh, header, picture, step};
use crate::batch::{Batch, open};
use crate::error::{StoreError, step_failed_to};

#[tokio::test]
async fn it_is_as_durable_as_the_other_and_keeps_the_rules() {
    let fresh = fresh().await;
    let connection = open(fresh.store.path()).unwrap();
    let pragma =
        |name| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0)).unwrap();
    assert_eq!(pragma("synchronous"), 2, "FULL");
    assert_eq!(pragma("foreign_keys"), 1);
    assert_eq!(pragma("busy_timeout"), 10_000);
    let journal: String =
        connection.pragma_query_value(None, "journal_mode", |row| row.get(0)).unwrap();
    assert_eq!(journal, "wal");
}

#[tokio::test]
async fn nothing_is_there_of_a_batch_that_fails_and_the_next_is_taken() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = SessionId::fresh();
    store.open(&header(id)).await.unwrap();
    let first = step(1, "p000", vec![picture("cam_a", b"wall")]);
    store.step(id, &first).await.unwrap();
    // Its capture has a name that is taken; its reading and its label come before that.
    let error = store.step(id, &step(2, "p000", Vec::new())).await.unwrap_err();
    assert!(error.reason.contains("refused to store a step: UNIQUE"), "{error}");
    let error = store.step(id, &first).await.unwrap_err();
    assert!(error.reason.ends_with("step 1 of this session is stored already"), "{error}");
    assert_eq!(store.steps(id).await.unwrap().len(), 1);
    assert_eq!(store.readings(id).await.unwrap().len(), 1);
    store.step(id, &step(2, "p001", Vec::new())).await.unwrap();
    assert_eq!(store.steps(id).await.unwrap().len(), 2);
}

#[tokio::test]
async fn a_step_that_nobody_waits_for_is_stored_before_what_comes_next() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = SessionId::fresh();
    store.open(&SessionHeader { steps: 50, ..header(id) }).await.unwrap();
    let mut given_up = 0;
    for number in 1..=50 {
        let bytes = vec![number as u8; 100_000];
        let step = step(number, &format!("p{number:03}"), vec![picture("cam_a", &bytes)]);
        let mut storing = store.step(id, &step);
        // Asked once, which sends it, and given up.
        let asked = std::future::poll_fn(|context| Poll::Ready(storing.as_mut().poll(context)));
        given_up += u32::from(asked.await.is_pending());
        drop(storing);
        // Its turn comes behind the step's, on the other connection.
        store.tag(id, &format!("tag-{number}"), at(0).utc).await.unwrap();
        assert_eq!(store.steps(id).await.unwrap().len(), number as usize);
    }
    assert!(given_up > 25, "{given_up}: most steps were stored before anybody could give them up");
    let found = store.verify(id).await.unwrap();
    assert!(found.is_sound(), "{found:?}");
}

#[tokio::test]
async fn a_database_that_is_held_is_busy() {
    let fresh = fresh().await;
    let mut other = stranger(fresh.store.path()).await;
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    let mut connection = open(fresh.store.path()).unwrap();
    connection.busy_timeout(Duration::from_millis(1)).unwrap();
    let mut batch = Batch::default();
    batch.statement("DELETE FROM sessions WHERE id = ?").bind("none");
    let error = step_failed_to("store a step", batch.write(&mut connection).unwrap_err());
    assert!(matches!(error, StoreError::Busy { .. }), "{error}");
    sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    batch.write(&mut connection).unwrap();
}
