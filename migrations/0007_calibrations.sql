-- Calibrations with what they were made from, and the files that solving was told.

-- A calibration is its file: the same bytes are the same calibration. No session owns it: it stays
-- when the one that it was made from is deleted.
CREATE TABLE calibrations (
    blake3        TEXT PRIMARY KEY NOT NULL CHECK (length(blake3) = 64), -- of `content_text`
    kind          TEXT NOT NULL CHECK (kind IN ('pattern', 'camera')),
    name          TEXT NOT NULL,
    method        TEXT NOT NULL,
    created_utc   TEXT NOT NULL CHECK (created_utc GLOB '????-??-??T*Z'),
    software      TEXT NOT NULL,
    options_json  TEXT NOT NULL CHECK (json_valid(options_json)),
    content_text  TEXT NOT NULL,
    parameters_json TEXT NOT NULL CHECK (json_type(parameters_json) = 'array'), -- name, value, u
    covariance_json TEXT NOT NULL CHECK (json_type(covariance_json) = 'array'), -- in their order
    result_json   TEXT NOT NULL CHECK (json_valid(result_json))
) STRICT;

CREATE TABLE calibration_sources (
    calibration   TEXT NOT NULL REFERENCES calibrations (blake3),
    place         INTEGER NOT NULL CHECK (place >= 1),
    kind          TEXT NOT NULL CHECK (kind IN ('session', 'file')),
    name          TEXT NOT NULL, -- of the file, or the session's title
    blake3        TEXT NOT NULL, -- of the file, or of the session's expanded plan
    made_from     TEXT CHECK (length(made_from) = 36), -- the session; not a reference: it may go
    processing_utc TEXT CHECK (processing_utc GLOB '????-??-??T*Z'), -- when the one used was begun
    deleted_utc   TEXT CHECK (deleted_utc GLOB '????-??-??T*Z'), -- when the session went
    PRIMARY KEY (calibration, place),
    CHECK ((kind = 'session') = (made_from IS NOT NULL))
) STRICT, WITHOUT ROWID;
CREATE INDEX calibration_sources_by_session ON calibration_sources (made_from);

-- What solving was told was read from these files: pattern and cameras' calibrations.
CREATE TABLE input_files (
    id            INTEGER PRIMARY KEY,
    session       TEXT NOT NULL REFERENCES sessions (id),
    processing    INTEGER, -- null: what the session was run with
    camera        TEXT, -- null: the pattern
    file          TEXT NOT NULL,
    blake3        TEXT NOT NULL CHECK (length(blake3) = 64),
    FOREIGN KEY (processing, session) REFERENCES processings (id, session)
) STRICT;
CREATE INDEX input_files_by_session ON input_files (session, processing);
CREATE INDEX input_files_by_hash ON input_files (blake3);

CREATE VIEW v_calibrations AS
SELECT c.blake3 AS calibration, c.kind, c.name, c.method, c.created_utc, c.software,
    c.options_json, c.parameters_json, c.covariance_json, c.content_text,
    (SELECT count(DISTINCT i.session) FROM input_files i WHERE i.blake3 = c.blake3)
        AS used_by_sessions
FROM calibrations c;

-- `stored`: 1 where the session is in this database.
CREATE VIEW v_calibration_sources AS
SELECT s.calibration, s.place, s.kind, s.name, s.blake3, s.made_from AS session,
    s.processing_utc,
    CASE WHEN s.made_from IS NOT NULL
        THEN EXISTS (SELECT 1 FROM sessions t WHERE t.id = s.made_from) END AS stored,
    s.deleted_utc
FROM calibration_sources s;

-- One row for each file of each processing; `calibration`: the recorded one that it is.
CREATE VIEW v_inputs AS
SELECT q.session, q.id AS processing, CASE WHEN i.camera IS NULL THEN 'pattern' ELSE 'camera' END
    AS kind, i.camera, i.file, i.blake3, c.blake3 AS calibration
FROM processings q
JOIN input_files i ON i.session = q.session AND i.processing IS
    CASE WHEN EXISTS (SELECT 1 FROM input_files o WHERE o.session = q.session
        AND o.processing = q.id) THEN q.id END
LEFT JOIN calibrations c ON c.blake3 = i.blake3;
