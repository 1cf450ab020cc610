//! What people put on a session: tags and notes.

use beampose_core::SessionId;

use crate::error::failed_to;
use crate::rows::Note;
use crate::stamp::timestamp;
use crate::writer::begin;
use crate::{Store, StoreError};

/// Longest tag, characters: what a table still shows.
const LONGEST_TAG: usize = 64;

/// A tag as it is stored: without space around it.
fn clean(tag: &str) -> Result<&str, StoreError> {
    let tag = tag.trim();
    let reason = if tag.is_empty() {
        "a tag has at least one character".to_owned()
    } else if tag.chars().count() > LONGEST_TAG {
        format!("a tag has at most {LONGEST_TAG} characters")
    } else if tag.chars().any(|c| c.is_control() || c.is_whitespace() || c == ',') {
        format!("{tag:?}: a tag is one word, without comma")
    } else {
        return Ok(tag);
    };
    Err(StoreError::Refused { doing: "tag a session".to_owned(), reason })
}

impl Store {
    /// Tags a session; one that has the tag already keeps it. True where the tag is new.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where there is no such session or the tag is none.
    pub async fn tag(
        &self,
        session: SessionId,
        tag: &str,
        at: jiff::Timestamp,
    ) -> Result<bool, StoreError> {
        let doing = "tag a session";
        let tag = clean(tag)?;
        let mut transaction = begin(&self.writer, doing).await?;
        let added = sqlx::query(
            "INSERT INTO tags (session, tag, added_utc) VALUES (?, ?, ?)
             ON CONFLICT (session, tag) DO NOTHING",
        )
        .bind(session.to_string())
        .bind(tag)
        .bind(at.to_string())
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))?;
        Ok(added.rows_affected() == 1)
    }

    /// Takes a tag off a session; false where it had none of that name.
    ///
    /// # Errors
    /// [`StoreError::Busy`], [`StoreError::Disk`] or [`StoreError::Database`].
    pub async fn untag(&self, session: SessionId, tag: &str) -> Result<bool, StoreError> {
        let doing = "take a tag off a session";
        let mut transaction = begin(&self.writer, doing).await?;
        let removed = sqlx::query("DELETE FROM tags WHERE session = ? AND tag = ?")
            .bind(session.to_string())
            .bind(tag.trim())
            .execute(&mut *transaction)
            .await
            .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))?;
        Ok(removed.rows_affected() == 1)
    }

    /// The tags of a session, by their names.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn tags(&self, session: SessionId) -> Result<Vec<String>, StoreError> {
        sqlx::query_scalar("SELECT tag FROM tags WHERE session = ? ORDER BY tag")
            .bind(session.to_string())
            .fetch_all(&self.readers)
            .await
            .map_err(failed_to("read the tags"))
    }

    /// Writes a note beside a session. Notes are added, never changed.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where there is no such session or the note is empty.
    pub async fn add_note(&self, session: SessionId, note: &Note) -> Result<(), StoreError> {
        let doing = "write a note";
        if note.text.trim().is_empty() {
            let reason = "it is empty".to_owned();
            return Err(StoreError::Refused { doing: doing.to_owned(), reason });
        }
        let mut transaction = begin(&self.writer, doing).await?;
        sqlx::query("INSERT INTO notes (session, written_utc, note) VALUES (?, ?, ?)")
            .bind(session.to_string())
            .bind(note.written.to_string())
            .bind(note.text.trim())
            .execute(&mut *transaction)
            .await
            .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))
    }

    /// The notes of a session, the oldest first.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn notes(&self, session: SessionId) -> Result<Vec<Note>, StoreError> {
        let rows: Vec<(String, String)> =
            sqlx::query_as("SELECT written_utc, note FROM notes WHERE session = ? ORDER BY id")
                .bind(session.to_string())
                .fetch_all(&self.readers)
                .await
                .map_err(failed_to("read the notes"))?;
        rows.into_iter()
            .map(|(written, text)| Ok(Note { written: timestamp(&written)?, text }))
            .collect()
    }
}
