-- What the plan's policies make of errors, what people answer, and more ways to end.

-- Finer than `outcome`, which says 'aborted' for both; null: `outcome` says it all.
ALTER TABLE sessions ADD COLUMN ending TEXT CHECK (ending IN ('stopped', 'halted'));

-- What the plan's policy made of a failed step; null: it ended the run.
ALTER TABLE steps ADD COLUMN handled TEXT CHECK (handled IN ('passed_over'));
ALTER TABLE attempts ADD COLUMN handled TEXT CHECK (handled IN ('passed_over'));

-- What should have been read or taken and was not, where the plan allows that.
CREATE TABLE missing_values (
    id            INTEGER PRIMARY KEY,
    session       TEXT NOT NULL,
    step          INTEGER NOT NULL,
    instrument    TEXT NOT NULL,
    reason        TEXT NOT NULL,
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT;
CREATE INDEX missing_values_by_session ON missing_values (session, id);

-- What operators answered.
CREATE TABLE answers (
    id            INTEGER PRIMARY KEY,
    session       TEXT NOT NULL,
    step          INTEGER NOT NULL,
    name          TEXT NOT NULL,
    value         TEXT NOT NULL,
    given_by      TEXT NOT NULL,
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT;
CREATE INDEX answers_by_session ON answers (session, id);

-- The views of 0003, with what is new.

DROP VIEW v_sessions;
CREATE VIEW v_sessions AS
SELECT s.id AS session, s.title, s.experiment, s.opened_utc, s.closed_utc,
    s.closed_s - s.opened_s AS duration_s,
    coalesce(s.ending, s.outcome, 'not closed') AS outcome,
    s.steps AS steps_planned,
    (SELECT count(*) FROM steps WHERE steps.session = s.id) AS steps_stored,
    (SELECT count(*) FROM captures WHERE captures.session = s.id) AS captures,
    (SELECT count(*) FROM missing_values m WHERE m.session = s.id) AS missing_values,
    (SELECT group_concat(tag, ' ') FROM tags WHERE tags.session = s.id) AS tags,
    s.software, s.seed, s.plan_hash
FROM sessions s;

-- `skew_s`: from the first camera's trigger to the last's.
DROP VIEW v_captures;
CREATE VIEW v_captures AS
SELECT c.session, c.id AS capture, c.step, c.triggered_utc, c.triggered_s,
    (SELECT max(requested_s) - min(requested_s) FROM pictures p
     WHERE p.session = c.session AND p.capture = c.id) AS skew_s,
    (SELECT count(*) FROM pictures p WHERE p.session = c.session AND p.capture = c.id) AS pictures,
    (SELECT sum(size_bytes) FROM pictures p
     WHERE p.session = c.session AND p.capture = c.id) AS pictures_bytes,
    c.setpoints_json, c.readings_json
FROM captures c;

-- One row for each value that should have been read or taken and was not.
CREATE VIEW v_missing AS
SELECT m.session, m.step, s.label, m.instrument, m.reason
FROM missing_values m JOIN steps s ON s.session = m.session AND s.number = m.step;

-- One row for each answer of an operator.
CREATE VIEW v_answers AS
SELECT a.session, a.step, a.name, a.value, a.given_by FROM answers a;
