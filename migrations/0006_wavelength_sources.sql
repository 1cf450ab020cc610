-- Whence the wavelength of a solution was known.

-- Null: solved by a version that did not record it.
ALTER TABLE poses ADD COLUMN wavelength_source TEXT CHECK (wavelength_source IN
    ('read', 'interpolated', 'held', 'from_temperature', 'estimated', 'nominal'));
-- Standard uncertainty of the wavelength before solving.
ALTER TABLE poses ADD COLUMN wavelength_u_nm REAL CHECK (wavelength_u_nm >= 0);
-- From the capture to the nearest reading that was used; null: read at the capture, or none used.
ALTER TABLE poses ADD COLUMN wavelength_age_s REAL CHECK (wavelength_age_s >= 0);

-- The view of 0003, with what is new.
DROP VIEW v_poses;
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
    p.covariance_json, p.beams_used, p.sigma0, p.wavelength_nm, p.wavelength_source,
    p.wavelength_u_nm, p.wavelength_age_s, p.ambiguous
FROM poses p
JOIN v_processings q ON q.processing = p.processing
JOIN captures c ON c.session = q.session AND c.id = p.capture;
