-- What the plan's policies make of errors, what people answer, and more ways to end.

-- Finer than `outcome`, which says 'aborted' for both; null: `outcome` says it all.
ALTER TABLE sessions ADD COLUMN ending TEXT CHECK (ending IN ('stopped', 'halted'));

-- What the plan's policy made of a failed step; null: it ended the run.
ALTER TABLE steps ADD COLUMN handled TEXT CHECK (handled IN ('passed_over'));

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
