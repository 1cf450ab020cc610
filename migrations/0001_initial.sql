-- The tables of beampose. Migrations are append-only: never edit this file, add another.
--
-- Conventions: `*_utc` is RFC 3339 UTC, `*_s` the same instant in seconds of the run's monotonic
-- clock, units are suffixes, `*_json` is compact JSON. Poses are `world_from_module`.

-- 'bpos': tells a beampose database from any other program's.
PRAGMA application_id = 1651535731;

CREATE TABLE sessions (
    number        INTEGER PRIMARY KEY AUTOINCREMENT, -- order of creation: what `latest` goes by
    id            TEXT NOT NULL UNIQUE CHECK (length(id) = 36),
    title         TEXT NOT NULL,
    experiment    TEXT NOT NULL,
    plan_text     TEXT NOT NULL,
    rig_text      TEXT NOT NULL,
    measurement_json TEXT NOT NULL CHECK (json_valid(measurement_json)),
    plan_hash     TEXT NOT NULL,
    software      TEXT NOT NULL,
    seed          TEXT CHECK (seed NOT GLOB '*[^0-9]*'), -- text: 64 bits without a sign
    steps         INTEGER NOT NULL CHECK (steps >= 0),
    opened_utc    TEXT NOT NULL CHECK (opened_utc GLOB '????-??-??T*Z'),
    opened_s      REAL NOT NULL CHECK (opened_s >= 0),
    closed_utc    TEXT CHECK (closed_utc GLOB '????-??-??T*Z'),
    closed_s      REAL CHECK (closed_s >= 0),
    outcome       TEXT CHECK (outcome IN ('completed', 'aborted', 'error')),
    CHECK ((closed_utc IS NULL) = (outcome IS NULL) AND (closed_s IS NULL) = (outcome IS NULL))
) STRICT;

CREATE TABLE steps (
    session       TEXT NOT NULL REFERENCES sessions (id),
    number        INTEGER NOT NULL CHECK (number >= 1),
    label         TEXT NOT NULL,
    kind          TEXT NOT NULL,
    started_utc   TEXT NOT NULL CHECK (started_utc GLOB '????-??-??T*Z'),
    started_s     REAL NOT NULL,
    finished_utc  TEXT NOT NULL CHECK (finished_utc GLOB '????-??-??T*Z'),
    finished_s    REAL NOT NULL CHECK (finished_s >= started_s),
    outcome       TEXT NOT NULL CHECK (outcome IN ('done', 'failed', 'skipped')),
    reason        TEXT,
    PRIMARY KEY (session, number),
    CHECK ((outcome = 'failed') = (reason IS NOT NULL))
) STRICT, WITHOUT ROWID;

CREATE TABLE events (
    id            INTEGER PRIMARY KEY,
    session       TEXT NOT NULL REFERENCES sessions (id),
    step          INTEGER, -- null: when the session closed
    at_utc        TEXT NOT NULL CHECK (at_utc GLOB '????-??-??T*Z'),
    at_s          REAL NOT NULL,
    kind          TEXT NOT NULL,
    message       TEXT NOT NULL,
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT;
CREATE INDEX events_by_session ON events (session, id);

CREATE TABLE readings (
    id            INTEGER PRIMARY KEY,
    session       TEXT NOT NULL,
    step          INTEGER NOT NULL,
    instrument    TEXT NOT NULL,
    quantity      TEXT NOT NULL
        CHECK (quantity IN ('position', 'angle', 'wavelength', 'temperature', 'current')),
    value         REAL NOT NULL, -- in the unit of the quantity: mm, deg, nm, degC, mA
    standard_uncertainty REAL CHECK (standard_uncertainty >= 0),
    at_utc        TEXT NOT NULL CHECK (at_utc GLOB '????-??-??T*Z'),
    at_s          REAL NOT NULL,
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT;
CREATE INDEX readings_by_session ON readings (session, id);

CREATE TABLE captures (
    session       TEXT NOT NULL,
    id            TEXT NOT NULL,
    step          INTEGER NOT NULL,
    setpoints_json TEXT NOT NULL CHECK (json_valid(setpoints_json)),
    readings_json TEXT NOT NULL CHECK (json_valid(readings_json)),
    triggered_utc TEXT NOT NULL CHECK (triggered_utc GLOB '????-??-??T*Z'),
    triggered_s   REAL NOT NULL,
    PRIMARY KEY (session, id),
    UNIQUE (session, step),
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT, WITHOUT ROWID;

-- Identical pictures are stored once.
CREATE TABLE blobs (
    id            INTEGER PRIMARY KEY,
    blake3        TEXT NOT NULL UNIQUE CHECK (length(blake3) = 64),
    bytes         BLOB NOT NULL
) STRICT;

CREATE TABLE pictures (
    session       TEXT NOT NULL,
    capture       TEXT NOT NULL,
    camera        TEXT NOT NULL,
    blake3        TEXT NOT NULL REFERENCES blobs (blake3),
    size_bytes    INTEGER NOT NULL CHECK (size_bytes >= 0),
    requested_utc TEXT NOT NULL CHECK (requested_utc GLOB '????-??-??T*Z'),
    requested_s   REAL NOT NULL,
    delivered_utc TEXT NOT NULL CHECK (delivered_utc GLOB '????-??-??T*Z'),
    delivered_s   REAL NOT NULL,
    PRIMARY KEY (session, capture, camera),
    FOREIGN KEY (session, capture) REFERENCES captures (session, id)
) STRICT, WITHOUT ROWID;
CREATE INDEX pictures_by_blob ON pictures (blake3);

-- One solve of a session. Never overwritten: solving again makes another.
CREATE TABLE processings (
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    session       TEXT NOT NULL REFERENCES sessions (id),
    created_utc   TEXT NOT NULL CHECK (created_utc GLOB '????-??-??T*Z'),
    finished_utc  TEXT CHECK (finished_utc GLOB '????-??-??T*Z'),
    software      TEXT NOT NULL,
    options_json  TEXT NOT NULL CHECK (json_valid(options_json)),
    lineage_json  TEXT NOT NULL CHECK (json_valid(lineage_json)),
    UNIQUE (id, session)
) STRICT;
CREATE INDEX processings_by_session ON processings (session, id);

CREATE TABLE solutions (
    processing    INTEGER NOT NULL,
    session       TEXT NOT NULL,
    capture       TEXT NOT NULL,
    seconds_json  TEXT NOT NULL CHECK (json_valid(seconds_json)),
    solution_json TEXT NOT NULL CHECK (json_valid(solution_json)),
    PRIMARY KEY (processing, capture),
    FOREIGN KEY (processing, session) REFERENCES processings (id, session),
    FOREIGN KEY (session, capture) REFERENCES captures (session, id)
) STRICT;

CREATE TABLE poses (
    processing    INTEGER NOT NULL,
    capture       TEXT NOT NULL,
    method        TEXT NOT NULL,
    status        TEXT NOT NULL CHECK (status IN ('solved', 'failed')),
    reason        TEXT,
    x_mm          REAL,
    y_mm          REAL,
    z_mm          REAL,
    qw            REAL,
    qx            REAL,
    qy            REAL,
    qz            REAL,
    covariance_json TEXT CHECK (json_array_length(covariance_json) = 6), -- mm, then rad
    beams_used    INTEGER NOT NULL CHECK (beams_used >= 0),
    sigma0        REAL,
    wavelength_nm REAL,
    ambiguous     INTEGER NOT NULL CHECK (ambiguous IN (0, 1)),
    PRIMARY KEY (processing, capture, method),
    FOREIGN KEY (processing, capture) REFERENCES solutions (processing, capture),
    CHECK ((status = 'failed') = (reason IS NOT NULL)),
    CHECK (status = 'failed' OR (
        x_mm IS NOT NULL AND y_mm IS NOT NULL AND z_mm IS NOT NULL AND
        qw IS NOT NULL AND qx IS NOT NULL AND qy IS NOT NULL AND qz IS NOT NULL AND
        covariance_json IS NOT NULL))
) STRICT, WITHOUT ROWID;

-- All observations of one camera in one capture as one JSON array: they are read and drawn a
-- camera at a time, and a row for each would be 24 000 inserts for a session of 60 captures with
-- three cameras, a second or so of writing that competes with the run for the one writer.
CREATE TABLE observations (
    processing    INTEGER NOT NULL,
    capture       TEXT NOT NULL,
    camera        TEXT NOT NULL,
    observations_json TEXT NOT NULL CHECK (json_type(observations_json) = 'array'),
    PRIMARY KEY (processing, capture, camera),
    FOREIGN KEY (processing, capture) REFERENCES solutions (processing, capture)
) STRICT;

CREATE TABLE results (
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    processing    INTEGER NOT NULL REFERENCES processings (id),
    created_utc   TEXT NOT NULL CHECK (created_utc GLOB '????-??-??T*Z'),
    result_json   TEXT NOT NULL CHECK (json_valid(result_json))
) STRICT;
CREATE INDEX results_by_processing ON results (processing, id);

-- What the simulation knows and the measurement must not: stored apart, for scoring alone.
CREATE TABLE simulation_truth (
    session       TEXT NOT NULL,
    capture       TEXT NOT NULL,
    truth_json    TEXT NOT NULL CHECK (json_valid(truth_json)),
    PRIMARY KEY (session, capture),
    FOREIGN KEY (session, capture) REFERENCES captures (session, id)
) STRICT;

CREATE TABLE simulation_truth_parameters (
    session       TEXT PRIMARY KEY NOT NULL REFERENCES sessions (id),
    truth_json    TEXT NOT NULL CHECK (json_valid(truth_json))
) STRICT;
