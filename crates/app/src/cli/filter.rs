//! Which of the stored sessions a command is about.

use beampose_analysis::Verdict;
use beampose_plan::read_rig_as_it_is;
use beampose_store::{SessionSummary, Store};
use jiff::Timestamp;
use jiff::civil::{Date, time};
use jiff::tz::TimeZone;

use super::Ended;
use crate::input::Origin;

/// Conditions that a session must all meet.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
#[command(next_help_heading = "Which sessions")]
pub struct Filter {
    /// Of this kind of experiment, as in `translation`
    #[arg(long, value_name = "NAME")]
    experiment: Option<String>,
    /// Begun on this day or later: 2026-11-20, or 2026-11-20T08:30:00Z (UTC)
    #[arg(long, value_name = "WHEN", value_parser = from)]
    since: Option<Timestamp>,
    /// Begun on this day or before
    #[arg(long, value_name = "WHEN", value_parser = to)]
    until: Option<Timestamp>,
    /// On a rig with this in its title or in the name of its file
    #[arg(long, value_name = "TEXT")]
    rig: Option<String>,
    /// With this verdict: pass, fail, inconclusive, aborted, error, or none (not analysed)
    #[arg(long, value_parser = ["pass", "fail", "inconclusive", "aborted", "error", "none"])]
    verdict: Option<String>,
    /// With this tag; several: with all of them
    #[arg(long = "tag", value_name = "TAG")]
    tags: Vec<String>,
    /// The newest N of them
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
}

impl Filter {
    /// True where nothing is asked for.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The sessions that meet it, the oldest first.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub async fn sessions(&self, store: &Store) -> Result<Vec<SessionSummary>, Ended> {
        let mut found = Vec::new();
        for session in store.sessions().await? {
            if self.fits(&session) && self.fits_rig(store, &session).await? {
                found.push(session);
            }
        }
        if let Some(limit) = self.limit {
            found.drain(..found.len().saturating_sub(limit));
        }
        Ok(found)
    }

    fn fits(&self, session: &SessionSummary) -> bool {
        self.experiment.as_ref().is_none_or(|wanted| session.experiment == *wanted)
            && self.since.is_none_or(|since| session.opened.utc >= since)
            && self.until.is_none_or(|until| session.opened.utc <= until)
            && self.verdict.as_ref().is_none_or(|wanted| verdict(session) == *wanted)
            && self.tags.iter().all(|tag| session.tags.contains(tag))
    }

    async fn fits_rig(&self, store: &Store, session: &SessionSummary) -> Result<bool, Ended> {
        let Some(wanted) = &self.rig else { return Ok(true) };
        let header = store.session(session.id).await?.header;
        let title = read_rig_as_it_is("stored rig", header.rig_text.as_bytes()).value;
        let origin = header.origin_json.as_deref().and_then(|j| serde_json::from_str(j).ok());
        let file = origin.and_then(|o: Origin| Some(o.rig.file_name()?.display().to_string()));
        let names = title.map(|rig| rig.title).into_iter().chain(file);
        let wanted = wanted.to_lowercase();
        Ok(names.map(|name| name.to_lowercase()).any(|name| name.contains(&wanted)))
    }
}

/// A session's verdict as a word; `none` where it was not analysed, or is not closed yet.
pub fn verdict(session: &SessionSummary) -> &'static str {
    let said = session.verdict.as_ref().and_then(|word| {
        serde_json::from_value::<Verdict>(serde_json::Value::String(word.clone())).ok()
    });
    match (session.outcome, said) {
        (None, _) => "none",
        (Some(outcome), said) => {
            match (Verdict::of_session(outcome, Verdict::Inconclusive), said) {
                (Verdict::Inconclusive, None) => "none",
                (Verdict::Inconclusive, Some(said)) => said.as_str(),
                (ended, _) => ended.as_str(),
            }
        }
    }
}

fn from(text: &str) -> Result<Timestamp, String> {
    instant(text, |day| day.to_zoned(TimeZone::UTC))
}

fn to(text: &str) -> Result<Timestamp, String> {
    instant(text, |day| day.to_datetime(time(23, 59, 59, 999_999_999)).to_zoned(TimeZone::UTC))
}

fn instant(
    text: &str,
    of_day: impl Fn(Date) -> Result<jiff::Zoned, jiff::Error>,
) -> Result<Timestamp, String> {
    if let Ok(at) = text.parse::<Timestamp>() {
        return Ok(at);
    }
    let day = text.parse::<Date>().and_then(of_day).map(|zoned| zoned.timestamp());
    day.map_err(|_| "expected a day as 2026-11-20, or 2026-11-20T08:30:00Z".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_day_is_all_of_it() {
        assert_eq!(from("2026-11-20").unwrap().to_string(), "2026-11-20T00:00:00Z");
        assert_eq!(to("2026-11-20").unwrap().to_string(), "2026-11-20T23:59:59.999999999Z");
        for both in [from, to] {
            assert_eq!(both("2026-11-20T08:30:00Z").unwrap().to_string(), "2026-11-20T08:30:00Z");
            assert!(both("yesterday").is_err() && both("2026-13-01").is_err());
        }
    }
}
