-- Closing-in: where an axis stood and where the dot was, look by look.

CREATE TABLE looks (
    id            INTEGER PRIMARY KEY,
    session       TEXT NOT NULL,
    step          INTEGER NOT NULL,
    commanded     REAL NOT NULL, -- in the axis' unit, as is `read`
    read          REAL NOT NULL,
    dot_x_px      REAL, -- at the camera's full size; null: the dot was not found
    dot_y_px      REAL,
    at_utc        TEXT NOT NULL CHECK (at_utc GLOB '????-??-??T*Z'),
    at_s          REAL NOT NULL,
    CHECK ((dot_x_px IS NULL) = (dot_y_px IS NULL)),
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT;
CREATE INDEX looks_by_session ON looks (session, id);

CREATE VIEW v_looks AS
SELECT l.session, l.step, s.label, l.commanded, l.read, l.dot_x_px, l.dot_y_px, l.at_utc, l.at_s
FROM looks l JOIN steps s ON s.session = l.session AND s.number = l.step;
