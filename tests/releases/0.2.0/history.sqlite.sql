BEGIN TRANSACTION;
CREATE TABLE acts (
	alert_id VARCHAR(64) NOT NULL, 
	at_ns BIGINT NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	who VARCHAR(64) NOT NULL, 
	PRIMARY KEY (alert_id, at_ns, state)
);
INSERT INTO "acts" VALUES('alert-of-a-long-history-0',1764000000000000000,'acknowledged','ann');
INSERT INTO "acts" VALUES('alert-of-a-long-history-1',1764033333333333333,'acknowledged','ann');
INSERT INTO "acts" VALUES('alert-of-a-long-history-2',1764066666666666666,'acknowledged','ann');
CREATE TABLE alert_objects (
	alert_id VARCHAR(64) NOT NULL, 
	site VARCHAR(64) NOT NULL, 
	object VARCHAR(64) NOT NULL, 
	PRIMARY KEY (alert_id)
);
CREATE TABLE alerts (
	id VARCHAR(64) NOT NULL, 
	rule VARCHAR(256) NOT NULL, 
	severity VARCHAR(16) NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	robot VARCHAR(64) NOT NULL, 
	camera VARCHAR(64) NOT NULL, 
	name VARCHAR(256) NOT NULL, 
	text TEXT NOT NULL, 
	raised_ns BIGINT NOT NULL, 
	changed_ns BIGINT NOT NULL, 
	PRIMARY KEY (id)
);
INSERT INTO "alerts" VALUES('alert-of-a-long-history-0','near','warning','raised','r0','front','box','box is near',1764000000000000000,1764666666666666660);
INSERT INTO "alerts" VALUES('alert-of-a-long-history-1','near','warning','resolved','r1','front','box','box is near',1764033333333333333,1764699999999999993);
INSERT INTO "alerts" VALUES('alert-of-a-long-history-2','near','warning','resolved','r2','front','box','box is near',1764066666666666666,1764733333333333326);
CREATE TABLE clock_correction (
	name VARCHAR(32) NOT NULL, 
	from_ns BIGINT NOT NULL, 
	ahead_ns BIGINT NOT NULL, 
	next_ns BIGINT NOT NULL, 
	PRIMARY KEY (name, from_ns)
);
CREATE TABLE clock_doubt (
	id INTEGER NOT NULL, 
	believed_ns BIGINT NOT NULL, 
	doubted_ns BIGINT NOT NULL, 
	trusted BOOLEAN NOT NULL, 
	PRIMARY KEY (id)
);
CREATE TABLE disagreements (
	robot VARCHAR(64) NOT NULL, 
	camera VARCHAR(64) NOT NULL, 
	name VARCHAR(256) NOT NULL, 
	since_ns BIGINT NOT NULL, 
	until_ns BIGINT NOT NULL, 
	open BOOLEAN NOT NULL, 
	count BIGINT NOT NULL, 
	model VARCHAR(256) NOT NULL, 
	other_count BIGINT NOT NULL, 
	other_model VARCHAR(256) NOT NULL, 
	PRIMARY KEY (robot, camera, name, since_ns)
);
INSERT INTO "disagreements" VALUES('r0','front','box',1764000000000000000,1764666666666666660,0,1,'m',2,'n');
INSERT INTO "disagreements" VALUES('r1','front','box',1764033333333333333,1764699999999999993,0,1,'m',2,'n');
INSERT INTO "disagreements" VALUES('r2','front','box',1764066666666666666,1764733333333333326,0,1,'m',2,'n');
CREATE TABLE forgotten (
	robot VARCHAR(64) NOT NULL, 
	at_ns BIGINT NOT NULL, 
	PRIMARY KEY (robot)
);
INSERT INTO "forgotten" VALUES('gone0',1764000000000000000);
INSERT INTO "forgotten" VALUES('gone1',1764033333333333333);
INSERT INTO "forgotten" VALUES('gone2',1764066666666666666);
CREATE TABLE heartbeat (
	id INTEGER NOT NULL, 
	at_ns BIGINT NOT NULL, 
	PRIMARY KEY (id)
);
INSERT INTO "heartbeat" VALUES(1,1764100000000000000);
CREATE TABLE intervals (
	robot VARCHAR(64) NOT NULL, 
	camera VARCHAR(64) NOT NULL, 
	name VARCHAR(256) NOT NULL, 
	since_ns BIGINT NOT NULL, 
	until_ns BIGINT NOT NULL, 
	open BOOLEAN NOT NULL, 
	count BIGINT NOT NULL, 
	score FLOAT NOT NULL, 
	closest_m FLOAT, 
	first_ns BIGINT NOT NULL, 
	model VARCHAR(256) NOT NULL, 
	worker VARCHAR(256) NOT NULL, 
	PRIMARY KEY (robot, camera, name, since_ns)
);
INSERT INTO "intervals" VALUES('r0','front','box',1764000000000000000,1764666666666666660,0,1,0.5,1.25,1764000000000000000,'m','w');
INSERT INTO "intervals" VALUES('r1','front','box',1764033333333333333,1764699999999999993,0,2,0.5,1.25,1764033333333333333,'m','w');
INSERT INTO "intervals" VALUES('r2','front','box',1764066666666666666,1764733333333333326,0,3,0.5,1.25,1764066666666666666,'m','w');
CREATE TABLE logins (
	digest VARCHAR(64) NOT NULL, 
	user VARCHAR(64) NOT NULL, 
	kind VARCHAR(16) NOT NULL, 
	user_ns BIGINT NOT NULL, 
	until_ns BIGINT NOT NULL, 
	PRIMARY KEY (digest)
);
CREATE TABLE object_events (
	site VARCHAR(64) NOT NULL, 
	object VARCHAR(64) NOT NULL, 
	kind VARCHAR(64) NOT NULL, 
	since_ns BIGINT NOT NULL, 
	until_ns BIGINT NOT NULL, 
	open BOOLEAN NOT NULL, 
	name VARCHAR(256) NOT NULL, 
	x FLOAT NOT NULL, 
	y FLOAT NOT NULL, 
	from_x FLOAT, 
	from_y FLOAT, 
	"into" VARCHAR(64) NOT NULL, 
	"by" VARCHAR(64) NOT NULL, 
	PRIMARY KEY (site, object, kind, since_ns)
);
INSERT INTO "object_events" VALUES('hall','o0','moved',1764000000000000000,1764000000000000000,0,'box',1.5,2.5,3.5,4.5,'','r1');
INSERT INTO "object_events" VALUES('hall','o1','moved',1764033333333333333,1764033333333333333,0,'box',1.5,2.5,3.5,4.5,'','r1');
INSERT INTO "object_events" VALUES('hall','o2','moved',1764066666666666666,1764066666666666666,0,'box',1.5,2.5,3.5,4.5,'','r1');
CREATE TABLE poses (
	robot VARCHAR(64) NOT NULL, 
	x FLOAT NOT NULL, 
	y FLOAT NOT NULL, 
	yaw FLOAT NOT NULL, 
	at_ns BIGINT NOT NULL, 
	PRIMARY KEY (robot)
);
INSERT INTO "poses" VALUES('r0',1.5,2.5,0.5,1764000000000000000);
INSERT INTO "poses" VALUES('r1',1.5,2.5,0.5,1764033333333333333);
INSERT INTO "poses" VALUES('r2',1.5,2.5,0.5,1764066666666666666);
CREATE TABLE presence (
	robot VARCHAR(64) NOT NULL, 
	camera VARCHAR(64) NOT NULL, 
	since_ns BIGINT NOT NULL, 
	until_ns BIGINT NOT NULL, 
	open BOOLEAN NOT NULL, 
	heard_ns BIGINT, 
	PRIMARY KEY (robot, camera, since_ns)
);
INSERT INTO "presence" VALUES('r0','front',1764000000000000000,1764666666666666660,0,NULL);
INSERT INTO "presence" VALUES('r1','front',1764033333333333333,1764699999999999993,0,NULL);
INSERT INTO "presence" VALUES('r2','front',1764066666666666666,1764733333333333326,0,NULL);
CREATE TABLE schema_version (
	id INTEGER NOT NULL, 
	number INTEGER NOT NULL, 
	PRIMARY KEY (id)
);
INSERT INTO "schema_version" VALUES(1,1);
ANALYZE "sqlite_master";
INSERT INTO "sqlite_stat1" VALUES('intervals','intervals_by_end','3 1');
INSERT INTO "sqlite_stat1" VALUES('intervals','sqlite_autoindex_intervals_1','3 1 1 1 1');
INSERT INTO "sqlite_stat1" VALUES('presence','presence_by_end','3 1');
INSERT INTO "sqlite_stat1" VALUES('presence','sqlite_autoindex_presence_1','3 1 1 1');
INSERT INTO "sqlite_stat1" VALUES('disagreements','disagreements_by_end','3 1');
INSERT INTO "sqlite_stat1" VALUES('disagreements','sqlite_autoindex_disagreements_1','3 1 1 1 1');
INSERT INTO "sqlite_stat1" VALUES('stock','stock_by_end','3 1');
INSERT INTO "sqlite_stat1" VALUES('stock','sqlite_autoindex_stock_1','3 3 1 1 1');
INSERT INTO "sqlite_stat1" VALUES('object_events','object_events_by_end','3 1');
INSERT INTO "sqlite_stat1" VALUES('object_events','sqlite_autoindex_object_events_1','3 3 1 1 1');
INSERT INTO "sqlite_stat1" VALUES('alerts','alerts_by_change','3 1');
INSERT INTO "sqlite_stat1" VALUES('alerts','alerts_open','1 1');
INSERT INTO "sqlite_stat1" VALUES('alerts','sqlite_autoindex_alerts_1','3 1');
INSERT INTO "sqlite_stat1" VALUES('acts','sqlite_autoindex_acts_1','3 1 1 1');
INSERT INTO "sqlite_stat1" VALUES('forgotten','sqlite_autoindex_forgotten_1','3 1');
INSERT INTO "sqlite_stat1" VALUES('poses','sqlite_autoindex_poses_1','3 1');
CREATE TABLE stock (
	site VARCHAR(64) NOT NULL, 
	zone VARCHAR(64) NOT NULL, 
	name VARCHAR(256) NOT NULL, 
	since_ns BIGINT NOT NULL, 
	until_ns BIGINT NOT NULL, 
	open BOOLEAN NOT NULL, 
	count BIGINT NOT NULL, 
	PRIMARY KEY (site, zone, name, since_ns)
);
INSERT INTO "stock" VALUES('hall','zone 0','box',1764000000000000000,1764666666666666660,0,0);
INSERT INTO "stock" VALUES('hall','zone 1','box',1764033333333333333,1764699999999999993,0,1);
INSERT INTO "stock" VALUES('hall','zone 2','box',1764066666666666666,1764733333333333326,0,2);
CREATE TABLE users (
	name VARCHAR(64) NOT NULL, 
	role VARCHAR(16) NOT NULL, 
	password TEXT NOT NULL, 
	changed_ns BIGINT NOT NULL, 
	PRIMARY KEY (name)
);
INSERT INTO "users" VALUES('ann','operator','$argon2id$v=19$m=19456,t=2,p=1$YyS9TOTKvtBAmWBfctYH1g$SQYpjgpfzn57DxOSXyD1hjCwwIHB7zhjlxqxRsZDFi0',1764100000000000000);
CREATE TABLE webhook_backlog (
	webhook TEXT NOT NULL, 
	alert_id VARCHAR(64) NOT NULL, 
	changed_ns BIGINT NOT NULL, 
	PRIMARY KEY (webhook, alert_id)
);
CREATE INDEX intervals_by_end ON intervals (until_ns);
CREATE INDEX intervals_open ON intervals (since_ns) WHERE open = 1;
CREATE INDEX presence_by_end ON presence (until_ns);
CREATE INDEX presence_open ON presence (since_ns) WHERE open = 1;
CREATE INDEX disagreements_open ON disagreements (since_ns) WHERE open = 1;
CREATE INDEX disagreements_by_end ON disagreements (until_ns);
CREATE INDEX stock_by_end ON stock (until_ns);
CREATE INDEX stock_open ON stock (since_ns) WHERE open = 1;
CREATE INDEX object_events_open ON object_events (since_ns) WHERE open = 1;
CREATE INDEX object_events_by_end ON object_events (until_ns);
CREATE INDEX alerts_open ON alerts (changed_ns) WHERE state != 'resolved';
CREATE INDEX alerts_by_change ON alerts (changed_ns);
CREATE INDEX logins_by_user ON logins (user);
COMMIT;
