-- Sessions that go on after they were stopped or died.

-- Where plan and rig came from and what the command line changed; null: imported.
ALTER TABLE sessions ADD COLUMN origin_json TEXT CHECK (json_valid(origin_json));

-- The time between the end of a run and the moment in which its session went on.
CREATE TABLE gaps (
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    session       TEXT NOT NULL REFERENCES sessions (id),
    stopped_utc   TEXT NOT NULL CHECK (stopped_utc GLOB '????-??-??T*Z'),
    stopped_s     REAL NOT NULL,
    resumed_utc   TEXT NOT NULL CHECK (resumed_utc GLOB '????-??-??T*Z'),
    resumed_s     REAL NOT NULL,
    reason        TEXT NOT NULL,
    restored_json TEXT NOT NULL CHECK (json_type(restored_json) = 'array')
) STRICT;
CREATE INDEX gaps_by_session ON gaps (session, id);

-- Steps as they ended before the gap, and were done again after it. What they read stays in
-- `readings`; the pictures that they took stay in `blobs`, and are named here.
CREATE TABLE attempts (
    gap           INTEGER NOT NULL REFERENCES gaps (id),
    session       TEXT NOT NULL REFERENCES sessions (id),
    step          INTEGER NOT NULL,
    label         TEXT NOT NULL,
    kind          TEXT NOT NULL,
    started_utc   TEXT NOT NULL,
    started_s     REAL NOT NULL,
    finished_utc  TEXT NOT NULL,
    finished_s    REAL NOT NULL,
    outcome       TEXT NOT NULL,
    reason        TEXT,
    capture_json  TEXT CHECK (json_valid(capture_json)),
    PRIMARY KEY (gap, step)
) STRICT, WITHOUT ROWID;
CREATE INDEX attempts_by_session ON attempts (session, step);
