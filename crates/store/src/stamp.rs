//! Values as columns: stamps, JSON, numbers.

use std::collections::BTreeMap;
use std::time::Duration;

use beampose_core::{SessionId, Stamp};

use crate::StoreError;

pub(crate) fn damaged(what: &str, reason: impl ToString) -> StoreError {
    StoreError::Damaged { what: what.to_owned(), reason: reason.to_string() }
}

/// A stamp from its two columns.
pub(crate) fn stamp(utc: &str, seconds: f64) -> Result<Stamp, StoreError> {
    let monotonic = Duration::try_from_secs_f64(seconds).map_err(|e| damaged("a time stamp", e))?;
    Ok(Stamp { monotonic, utc: timestamp(utc)? })
}

pub(crate) fn timestamp(utc: &str) -> Result<jiff::Timestamp, StoreError> {
    utc.parse().map_err(|e| damaged("a time stamp", e))
}

pub(crate) fn session_id(text: &str) -> Result<SessionId, StoreError> {
    text.parse().map(SessionId).map_err(|e| damaged("a session's id", e))
}

/// A count from its column, which a CHECK keeps from being negative.
pub(crate) fn count(value: i64) -> u64 {
    u64::try_from(value).unwrap_or(0)
}

pub(crate) fn step_number(value: i64) -> Result<u32, StoreError> {
    u32::try_from(value).map_err(|e| damaged("a step's number", e))
}

/// Numbers by name as JSON, which has no way to write a number that is none.
pub(crate) fn numbers_to_json(
    doing: &str,
    numbers: &BTreeMap<String, f64>,
) -> Result<String, StoreError> {
    if let Some((key, value)) = numbers.iter().find(|(_, value)| !value.is_finite()) {
        let reason = format!("{key} is {value}");
        return Err(StoreError::Refused { doing: doing.to_owned(), reason });
    }
    to_json(doing, numbers)
}

pub(crate) fn to_json(doing: &str, value: &impl serde::Serialize) -> Result<String, StoreError> {
    serde_json::to_string(value)
        .map_err(|error| StoreError::Refused { doing: doing.to_owned(), reason: error.to_string() })
}

pub(crate) fn from_json<T: serde::de::DeserializeOwned>(
    what: &str,
    json: &str,
) -> Result<T, StoreError> {
    serde_json::from_str(json).map_err(|error| damaged(what, error))
}

/// A word of a closed enum, as its serde name.
pub(crate) fn word_of(doing: &str, value: &impl serde::Serialize) -> Result<String, StoreError> {
    Ok(to_json(doing, value)?.trim_matches('"').to_owned())
}

/// A closed enum from its word.
pub(crate) fn from_word<T: serde::de::DeserializeOwned>(
    what: &str,
    word: &str,
) -> Result<T, StoreError> {
    serde_json::from_value(serde_json::Value::String(word.to_owned()))
        .map_err(|error| damaged(what, error))
}
