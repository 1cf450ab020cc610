//! Pictures: their bytes only with the hash verified.

use std::collections::BTreeMap;

use beampose_core::{CaptureId, InstrumentName, SessionId};
use sqlx::FromRow;

use crate::error::failed_to;
use crate::rows::PictureInfo;
use crate::stamp::{count, damaged, stamp};
use crate::{Store, StoreError};

#[derive(FromRow)]
struct PictureColumns {
    capture: String,
    camera: String,
    blake3: String,
    size_bytes: i64,
    requested_utc: String,
    requested_s: f64,
    delivered_utc: String,
    delivered_s: f64,
}

impl PictureColumns {
    fn info(self) -> Result<(String, PictureInfo), StoreError> {
        let info = PictureInfo {
            camera: InstrumentName(self.camera),
            blake3: self.blake3,
            size_bytes: count(self.size_bytes),
            requested: stamp(&self.requested_utc, self.requested_s)?,
            delivered: stamp(&self.delivered_utc, self.delivered_s)?,
        };
        Ok((self.capture, info))
    }
}

impl Store {
    /// The bytes that `camera` delivered for `capture`, as delivered.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where there is no such picture; [`StoreError::Damaged`] where its
    /// bytes do not have the hash that they had when they were stored.
    pub async fn picture(
        &self,
        session: SessionId,
        capture: &CaptureId,
        camera: &InstrumentName,
    ) -> Result<Vec<u8>, StoreError> {
        let row: Option<(String, Option<Vec<u8>>)> = sqlx::query_as(
            "SELECT p.blake3, b.bytes FROM pictures p LEFT JOIN blobs b ON b.blake3 = p.blake3
             WHERE p.session = ? AND p.capture = ? AND p.camera = ?",
        )
        .bind(session.to_string())
        .bind(capture.as_str())
        .bind(camera.as_str())
        .fetch_optional(&self.readers)
        .await
        .map_err(failed_to("read a picture"))?;
        let what = format!("picture of {camera} in capture {capture} of session {session}");
        let Some((hash, bytes)) = row else {
            return Err(StoreError::NotFound { what, nearest: Vec::new() });
        };
        let what = format!("the {what}");
        let bytes = bytes.ok_or_else(|| damaged(&what, "its bytes are missing"))?;
        let found = blake3::hash(&bytes).to_hex();
        if found.as_str() != hash {
            return Err(damaged(&what, format!("its BLAKE3 is {found}, stored as {hash}")));
        }
        Ok(bytes)
    }

    /// All pictures of a session by the captures' names, each list by the cameras' names.
    pub(crate) async fn picture_infos(
        &self,
        session: SessionId,
    ) -> Result<BTreeMap<String, Vec<PictureInfo>>, StoreError> {
        let rows: Vec<PictureColumns> = sqlx::query_as(
            "SELECT capture, camera, blake3, size_bytes, requested_utc, requested_s,
                delivered_utc, delivered_s
             FROM pictures WHERE session = ? ORDER BY capture, camera",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the pictures"))?;
        let mut by_capture: BTreeMap<String, Vec<PictureInfo>> = BTreeMap::new();
        for row in rows {
            let (capture, info) = row.info()?;
            by_capture.entry(capture).or_default().push(info);
        }
        Ok(by_capture)
    }
}
