//! The views for other programs: what docs/sql-views.md says of them is so.

use std::collections::BTreeMap;

use sqlx::{AssertSqlSafe, Row as _};

use super::fresh;
use super::keeping::full_session;

const DOCUMENT: &str = include_str!("../../../../docs/sql-views.md");

/// A result in the form of a translation test's.
pub(super) fn result(verdict: &str) -> String {
    let position = "{\"rail_mm\":300.0,\"travel_mm\":300.01,\"mean_difference_mm\":0.01,\
        \"standard_uncertainty_mm\":0.02,\"expanded_uncertainty_mm\":0.04,\
        \"standard_deviation_mm\":null,\"passes\":1}";
    format!(
        "{{\"experiment\":\"translation\",\"verdict\":\"{verdict}\",\"methods\":\
         {{\"virtual-camera\":{{\"positions\":[{position}]}}}}}}"
    )
}

/// The text between fences of a language.
fn fenced(language: &str) -> Vec<&'static str> {
    let begin = format!("```{language}\n");
    let parts = DOCUMENT.split(begin.as_str()).skip(1);
    parts.map(|part| part.split("```").next().unwrap()).collect()
}

/// The documented columns of each view: rows `| column | ...` under a heading of its name.
fn documented() -> BTreeMap<String, Vec<String>> {
    let mut views: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut current = None;
    for line in DOCUMENT.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            current = heading.strip_prefix('`').and_then(|h| h.split('`').next());
        } else if let (Some(view), Some(cell)) = (current, line.strip_prefix("| `")) {
            // Several columns of one kind share a row.
            let names = cell.split('|').next().unwrap().split(',');
            let names = names.map(|name| name.trim().trim_matches('`').to_owned());
            views.entry(view.to_owned()).or_default().extend(names);
        }
    }
    views
}

#[tokio::test]
async fn every_view_and_column_is_documented() {
    let fresh = fresh().await;
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let columns: Vec<(String, String)> = sqlx::query_as(
        "SELECT v.name, c.name FROM sqlite_schema v, pragma_table_info(v.name) c
         WHERE v.type = 'view' ORDER BY v.name, c.cid",
    )
    .fetch_all(&fresh.store.readers)
    .await
    .unwrap();
    for (view, column) in columns {
        found.entry(view).or_default().push(column);
    }
    assert!(found.len() >= 5);
    assert_eq!(documented(), found);
}

#[tokio::test]
async fn every_example_query_runs_and_finds_something() {
    let fresh = fresh().await;
    full_session(&fresh.store).await;
    let queries = fenced("sql");
    assert!(queries.len() >= 5, "{}", queries.len());
    for query in queries {
        let rows = sqlx::query(AssertSqlSafe(query)).fetch_all(&fresh.store.readers).await.unwrap();
        assert!(!rows.is_empty(), "{query}");
    }
}

#[tokio::test]
async fn the_views_show_what_is_stored() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = full_session(store).await;
    let one = async |sql: &'static str| {
        sqlx::query(sql).bind(id.to_string()).fetch_one(&store.readers).await.unwrap()
    };
    let row = one("SELECT * FROM v_poses WHERE session = ? AND latest AND status = 'solved'").await;
    assert_eq!(row.get::<f64, _>("x_mm"), 1.0 / 3.0);
    assert_eq!(row.get::<&str, _>("wavelength_source"), "interpolated");
    assert_eq!(row.get::<f64, _>("wavelength_u_nm"), 0.03);
    assert_eq!(row.get::<f64, _>("wavelength_age_s"), 12.5);
    assert_eq!(row.get::<f64, _>("var_y_mm2"), 0.1 / 4.0);
    assert_eq!(row.get::<f64, _>("var_rz_rad2"), 0.1 / 8.0);
    assert_eq!((row.get::<i64, _>("processing"), row.get::<i64, _>("step")), (2, 1));
    let row = one("SELECT * FROM v_results WHERE session = ? AND latest").await;
    assert_eq!(row.get::<&str, _>("verdict"), "fail");
    assert_eq!(row.get::<f64, _>("expanded_uncertainty_mm"), 0.04);
    let row = one("SELECT * FROM v_readings WHERE session = ? ORDER BY step").await;
    assert_eq!(row.get::<f64, _>("wavelength_nm"), 658.02);
    assert_eq!((row.get::<&str, _>("unit"), row.get::<&str, _>("capture")), ("nm", "p000"));
    assert_eq!(row.get::<Option<f64>, _>("temperature_degc"), None);
    let row = one("SELECT * FROM v_captures WHERE session = ? AND capture = 'p000'").await;
    assert_eq!((row.get::<i64, _>("pictures"), row.get::<i64, _>("pictures_bytes")), (2, 44));
    let row = one("SELECT value FROM v_capture_values
         WHERE session = ? AND capture = 'p000' AND kind = 'setpoint' AND name = 'rail_mm'")
    .await;
    assert_eq!(row.get::<f64, _>(0), 300.0);
    let row = one("SELECT * FROM v_sessions WHERE session = ?").await;
    assert_eq!((row.get::<&str, _>("outcome"), row.get::<&str, _>("tags")), ("completed", "warm"));
    assert_eq!(row.get::<f64, _>("duration_s"), 9.9);
    let row = one("SELECT * FROM v_pictures WHERE session = ?").await;
    assert_eq!(row.get::<f64, _>("latency_s"), 1.0);
}
