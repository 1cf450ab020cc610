-- Readings in the order of their session: an index for that cost each step another page to write.

DROP VIEW v_readings;

CREATE TABLE readings_in_order (
    session       TEXT NOT NULL,
    id            INTEGER NOT NULL CHECK (id >= 1), -- counts the readings of the session, as taken
    step          INTEGER NOT NULL,
    instrument    TEXT NOT NULL,
    quantity      TEXT NOT NULL
        CHECK (quantity IN ('position', 'angle', 'wavelength', 'temperature', 'current')),
    value         REAL NOT NULL, -- in the unit of the quantity: mm, deg, nm, degC, mA
    standard_uncertainty REAL CHECK (standard_uncertainty >= 0),
    at_utc        TEXT NOT NULL CHECK (at_utc GLOB '????-??-??T*Z'),
    at_s          REAL NOT NULL,
    PRIMARY KEY (session, id),
    FOREIGN KEY (session, step) REFERENCES steps (session, number)
) STRICT, WITHOUT ROWID;

INSERT INTO readings_in_order
SELECT session, row_number() OVER (PARTITION BY session ORDER BY id), step, instrument, quantity,
    value, standard_uncertainty, at_utc, at_s
FROM readings;

DROP TABLE readings;
ALTER TABLE readings_in_order RENAME TO readings;

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
