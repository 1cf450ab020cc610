-- Stored sessions: tags, notes, solving again with other inputs, views for other programs.

-- What solving was told, where that is not what the session was run with.
ALTER TABLE processings ADD COLUMN measurement_json TEXT CHECK (json_valid(measurement_json));
-- The command that began it with others, so that it can go on; null: beside a run.
ALTER TABLE processings ADD COLUMN batch TEXT CHECK (length(batch) = 36);

CREATE TABLE tags (
    session       TEXT NOT NULL REFERENCES sessions (id),
    tag           TEXT NOT NULL CHECK (length(tag) BETWEEN 1 AND 64),
    added_utc     TEXT NOT NULL CHECK (added_utc GLOB '????-??-??T*Z'),
    PRIMARY KEY (session, tag)
) STRICT, WITHOUT ROWID;
CREATE INDEX tags_by_tag ON tags (tag, session);

CREATE TABLE notes (
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    session       TEXT NOT NULL REFERENCES sessions (id),
    written_utc   TEXT NOT NULL CHECK (written_utc GLOB '????-??-??T*Z'),
    note          TEXT NOT NULL CHECK (length(note) >= 1)
) STRICT;
CREATE INDEX notes_by_session ON notes (session, id);

-- For other programs (docs/sql-views.md). Units are suffixes, and no function is used that an
-- SQLite of 2022 does not have.

CREATE VIEW v_sessions AS
SELECT s.id AS session, s.title, s.experiment, s.opened_utc, s.closed_utc,
    s.closed_s - s.opened_s AS duration_s, coalesce(s.outcome, 'not closed') AS outcome,
    s.steps AS steps_planned,
    (SELECT count(*) FROM steps WHERE steps.session = s.id) AS steps_stored,
    (SELECT count(*) FROM captures WHERE captures.session = s.id) AS captures,
    (SELECT group_concat(tag, ' ') FROM tags WHERE tags.session = s.id) AS tags,
    s.software, s.seed, s.plan_hash
FROM sessions s;

CREATE VIEW v_captures AS
SELECT c.session, c.id AS capture, c.step, c.triggered_utc, c.triggered_s,
    (SELECT count(*) FROM pictures p WHERE p.session = c.session AND p.capture = c.id) AS pictures,
    (SELECT sum(size_bytes) FROM pictures p
     WHERE p.session = c.session AND p.capture = c.id) AS pictures_bytes,
    c.setpoints_json, c.readings_json
FROM captures c;

-- One row for each setpoint, loop counter and reading of a capture; `name` ends in the unit.
CREATE VIEW v_capture_values AS
SELECT c.session, c.id AS capture, c.step, 'setpoint' AS kind, j.key AS name, j.value AS value
FROM captures c, json_each(c.setpoints_json) j
UNION ALL
SELECT c.session, c.id, c.step, 'reading', j.key, j.value
FROM captures c, json_each(c.readings_json) j;

CREATE VIEW v_pictures AS
SELECT p.session, p.capture, p.camera, p.blake3, p.size_bytes, p.requested_utc, p.delivered_utc,
    p.requested_s, p.delivered_s, p.delivered_s - p.requested_s AS latency_s
FROM pictures p;

CREATE VIEW v_readings AS
SELECT r.session, r.step, c.id AS capture, r.instrument, r.quantity,
    CASE r.quantity WHEN 'position' THEN 'mm' WHEN 'angle' THEN 'deg' WHEN 'wavelength' THEN 'nm'
        WHEN 'temperature' THEN 'degC' WHEN 'current' THEN 'mA' END AS unit,
    r.value, r.standard_uncertainty,
    CASE r.quantity WHEN 'position' THEN r.value END AS position_mm,
    CASE r.quantity WHEN 'angle' THEN r.value END AS angle_deg,
    CASE r.quantity WHEN 'wavelength' THEN r.value END AS wavelength_nm,
    CASE r.quantity WHEN 'temperature' THEN r.value END AS temperature_degc,
    CASE r.quantity WHEN 'current' THEN r.value END AS current_ma,
    r.at_utc, r.at_s
FROM readings r LEFT JOIN captures c ON c.session = r.session AND c.step = r.step;

CREATE VIEW v_processings AS
SELECT q.id AS processing, q.session, q.created_utc, q.finished_utc, q.software, q.options_json,
    q.lineage_json, q.measurement_json IS NOT NULL AS other_measurement,
    q.id IS (SELECT l.id FROM processings l WHERE l.session = q.session
        AND l.finished_utc IS NOT NULL ORDER BY l.id DESC LIMIT 1) AS latest
FROM processings q;

CREATE VIEW v_poses AS
SELECT q.session, q.processing, q.latest, c.step, p.capture, p.method, p.status, p.reason,
    p.x_mm, p.y_mm, p.z_mm, p.qw, p.qx, p.qy, p.qz,
    json_extract(p.covariance_json, '$[0][0]') AS var_x_mm2,
    json_extract(p.covariance_json, '$[1][1]') AS var_y_mm2,
    json_extract(p.covariance_json, '$[2][2]') AS var_z_mm2,
    json_extract(p.covariance_json, '$[0][1]') AS cov_xy_mm2,
    json_extract(p.covariance_json, '$[0][2]') AS cov_xz_mm2,
    json_extract(p.covariance_json, '$[1][2]') AS cov_yz_mm2,
    json_extract(p.covariance_json, '$[3][3]') AS var_rx_rad2,
    json_extract(p.covariance_json, '$[4][4]') AS var_ry_rad2,
    json_extract(p.covariance_json, '$[5][5]') AS var_rz_rad2,
    p.covariance_json, p.beams_used, p.sigma0, p.wavelength_nm, p.ambiguous
FROM poses p
JOIN v_processings q ON q.processing = p.processing
JOIN captures c ON c.session = q.session AND c.id = p.capture;

-- One row for each method and stop of a result; the newest result of each processing.
CREATE VIEW v_results AS
SELECT q.session, r.processing, q.latest, r.created_utc,
    json_extract(r.result_json, '$.experiment') AS experiment,
    json_extract(r.result_json, '$.verdict') AS verdict, m.key AS method,
    json_extract(s.value, '$.rail_mm') AS rail_mm,
    json_extract(s.value, '$.travel_mm') AS travel_mm,
    json_extract(s.value, '$.mean_difference_mm') AS mean_difference_mm,
    json_extract(s.value, '$.standard_uncertainty_mm') AS standard_uncertainty_mm,
    json_extract(s.value, '$.expanded_uncertainty_mm') AS expanded_uncertainty_mm,
    json_extract(s.value, '$.standard_deviation_mm') AS standard_deviation_mm,
    json_extract(s.value, '$.passes') AS passes
FROM results r
JOIN v_processings q ON q.processing = r.processing
JOIN json_each(r.result_json, '$.methods') m
JOIN json_each(m.value, '$.positions') s
WHERE r.id = (SELECT max(n.id) FROM results n WHERE n.processing = r.processing);
