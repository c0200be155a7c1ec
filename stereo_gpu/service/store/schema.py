"""The tables of the service, and what tells that a file holds them.

What must always hold stands in the tables themselves: a job has ended exactly if it has the time of its end, has an
error exactly if it failed, and runs only while somebody has leased it; who has leased it may let it wait a little yet.
"""

from __future__ import annotations

APPLICATION = 0x53475055  # "SGPU": PRAGMA application_id of our files
VERSION = 1  # PRAGMA user_version; a change of the tables needs a new one, and an entry in UPGRADES
UPGRADES: dict[int, str] = {}  # by the version that is found: the statements that make the next one of it

TABLES = """
CREATE TABLE clients (
  name TEXT PRIMARY KEY,
  created REAL NOT NULL,
  turn INTEGER NOT NULL DEFAULT 0   -- grows over all clients with each lease: who has the least waited longest
) WITHOUT ROWID;

CREATE TABLE tokens (
  sha256 BLOB PRIMARY KEY,
  client TEXT NOT NULL REFERENCES clients (name),
  created REAL NOT NULL
) WITHOUT ROWID;

CREATE TABLE rigs (
  number INTEGER PRIMARY KEY AUTOINCREMENT,
  id TEXT NOT NULL UNIQUE,
  client TEXT NOT NULL REFERENCES clients (name),
  name TEXT NOT NULL,
  created REAL NOT NULL,
  summary TEXT NOT NULL,
  calibration TEXT,
  checked INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX rigs_by_client ON rigs (client, number);

CREATE TABLE jobs (
  number INTEGER PRIMARY KEY AUTOINCREMENT,
  id TEXT NOT NULL UNIQUE,
  client TEXT NOT NULL REFERENCES clients (name),
  kind TEXT NOT NULL CHECK (kind IN ('reconstruction', 'calibration')),
  state TEXT NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed', 'cancelled')),
  created REAL NOT NULL,
  started REAL,
  ended REAL,
  tries INTEGER NOT NULL DEFAULT 0 CHECK (tries >= 0),
  attempt INTEGER NOT NULL DEFAULT 0 CHECK (attempt >= tries),   -- never given again, unlike tries: it names a folder
  owner TEXT,
  until REAL,
  stage TEXT,
  fraction REAL NOT NULL DEFAULT 0,
  error TEXT,
  warnings TEXT NOT NULL DEFAULT '[]',
  seconds TEXT NOT NULL DEFAULT '{}',
  summary TEXT NOT NULL DEFAULT '{}',
  rig TEXT,
  label TEXT NOT NULL DEFAULT '',
  options TEXT NOT NULL DEFAULT '{}',
  inputs TEXT NOT NULL DEFAULT '[]',
  pixels INTEGER NOT NULL DEFAULT 0,
  bytes INTEGER NOT NULL DEFAULT 0,
  cancel_asked INTEGER NOT NULL DEFAULT 0,
  CHECK ((state IN ('done', 'failed', 'cancelled')) = (ended IS NOT NULL)),
  CHECK (state <> 'running' OR owner IS NOT NULL),
  CHECK (ended IS NULL OR owner IS NULL),
  CHECK ((owner IS NULL) = (until IS NULL)),
  CHECK ((state = 'failed') = (error IS NOT NULL)),
  CHECK (state = 'running' OR NOT cancel_asked)
);
CREATE INDEX jobs_by_state ON jobs (state, client, number, owner);
CREATE INDEX jobs_leased ON jobs (client) WHERE owner IS NOT NULL;
CREATE INDEX jobs_by_client ON jobs (client, number);
CREATE INDEX jobs_by_kind ON jobs (client, kind, number);
CREATE INDEX jobs_ended ON jobs (ended, bytes) WHERE ended IS NOT NULL;
CREATE INDEX jobs_open_by_rig ON jobs (rig) WHERE ended IS NULL;

CREATE TABLE keys (
  client TEXT NOT NULL,
  key TEXT NOT NULL,
  fingerprint TEXT NOT NULL,
  job TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
  PRIMARY KEY (client, key)
) WITHOUT ROWID;
CREATE INDEX keys_by_job ON keys (job);
"""
