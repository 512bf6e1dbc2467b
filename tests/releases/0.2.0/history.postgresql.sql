SET statement_timeout = 0;
SET lock_timeout = 0;
SET idle_in_transaction_session_timeout = 0;
SET client_encoding = 'UTF8';
SET standard_conforming_strings = on;
SELECT pg_catalog.set_config('search_path', '', false);
SET check_function_bodies = false;
SET xmloption = content;
SET client_min_messages = warning;
SET row_security = off;
SET default_tablespace = '';
SET default_table_access_method = heap;
CREATE TABLE public.acts (
    alert_id character varying(64) NOT NULL,
    at_ns bigint NOT NULL,
    state character varying(16) NOT NULL,
    who character varying(64) NOT NULL
);
CREATE TABLE public.alert_objects (
    alert_id character varying(64) NOT NULL,
    site character varying(64) NOT NULL,
    object character varying(64) NOT NULL
);
CREATE TABLE public.alerts (
    id character varying(64) NOT NULL,
    rule character varying(256) NOT NULL,
    severity character varying(16) NOT NULL,
    state character varying(16) NOT NULL,
    robot character varying(64) NOT NULL,
    camera character varying(64) NOT NULL,
    name character varying(256) NOT NULL,
    text text NOT NULL,
    raised_ns bigint NOT NULL,
    changed_ns bigint NOT NULL
);
CREATE TABLE public.clock_correction (
    name character varying(32) NOT NULL,
    from_ns bigint NOT NULL,
    ahead_ns bigint NOT NULL,
    next_ns bigint NOT NULL
);
CREATE TABLE public.clock_doubt (
    id integer NOT NULL,
    believed_ns bigint NOT NULL,
    doubted_ns bigint NOT NULL,
    trusted boolean NOT NULL
);
CREATE TABLE public.disagreements (
    robot character varying(64) NOT NULL,
    camera character varying(64) NOT NULL,
    name character varying(256) NOT NULL,
    since_ns bigint NOT NULL,
    until_ns bigint NOT NULL,
    open boolean NOT NULL,
    count bigint NOT NULL,
    model character varying(256) NOT NULL,
    other_count bigint NOT NULL,
    other_model character varying(256) NOT NULL
);
CREATE TABLE public.forgotten (
    robot character varying(64) NOT NULL,
    at_ns bigint NOT NULL
);
CREATE TABLE public.heartbeat (
    id integer NOT NULL,
    at_ns bigint NOT NULL
);
CREATE TABLE public.intervals (
    robot character varying(64) NOT NULL,
    camera character varying(64) NOT NULL,
    name character varying(256) NOT NULL,
    since_ns bigint NOT NULL,
    until_ns bigint NOT NULL,
    open boolean NOT NULL,
    count bigint NOT NULL,
    score double precision NOT NULL,
    closest_m double precision,
    first_ns bigint NOT NULL,
    model character varying(256) NOT NULL,
    worker character varying(256) NOT NULL
);
CREATE TABLE public.logins (
    digest character varying(64) NOT NULL,
    "user" character varying(64) NOT NULL,
    kind character varying(16) NOT NULL,
    user_ns bigint NOT NULL,
    until_ns bigint NOT NULL
);
CREATE TABLE public.object_events (
    site character varying(64) NOT NULL,
    object character varying(64) NOT NULL,
    kind character varying(64) NOT NULL,
    since_ns bigint NOT NULL,
    until_ns bigint NOT NULL,
    open boolean NOT NULL,
    name character varying(256) NOT NULL,
    x double precision NOT NULL,
    y double precision NOT NULL,
    from_x double precision,
    from_y double precision,
    "into" character varying(64) NOT NULL,
    by character varying(64) NOT NULL
);
CREATE TABLE public.poses (
    robot character varying(64) NOT NULL,
    x double precision NOT NULL,
    y double precision NOT NULL,
    yaw double precision NOT NULL,
    at_ns bigint NOT NULL
);
CREATE TABLE public.presence (
    robot character varying(64) NOT NULL,
    camera character varying(64) NOT NULL,
    since_ns bigint NOT NULL,
    until_ns bigint NOT NULL,
    open boolean NOT NULL,
    heard_ns bigint
);
CREATE TABLE public.schema_version (
    id integer NOT NULL,
    number integer NOT NULL
);
CREATE TABLE public.stock (
    site character varying(64) NOT NULL,
    zone character varying(64) NOT NULL,
    name character varying(256) NOT NULL,
    since_ns bigint NOT NULL,
    until_ns bigint NOT NULL,
    open boolean NOT NULL,
    count bigint NOT NULL
);
CREATE TABLE public.users (
    name character varying(64) NOT NULL,
    role character varying(16) NOT NULL,
    password text NOT NULL,
    changed_ns bigint NOT NULL
);
CREATE TABLE public.webhook_backlog (
    webhook text NOT NULL,
    alert_id character varying(64) NOT NULL,
    changed_ns bigint NOT NULL
);
INSERT INTO public.acts VALUES ('alert-of-a-long-history-0', 1764000000000000000, 'acknowledged', 'ann');
INSERT INTO public.acts VALUES ('alert-of-a-long-history-1', 1764033333333333333, 'acknowledged', 'ann');
INSERT INTO public.acts VALUES ('alert-of-a-long-history-2', 1764066666666666666, 'acknowledged', 'ann');
INSERT INTO public.alerts VALUES ('alert-of-a-long-history-0', 'near', 'warning', 'raised', 'r0', 'front', 'box', 'box is near', 1764000000000000000, 1764666666666666660);
INSERT INTO public.alerts VALUES ('alert-of-a-long-history-1', 'near', 'warning', 'resolved', 'r1', 'front', 'box', 'box is near', 1764033333333333333, 1764699999999999993);
INSERT INTO public.alerts VALUES ('alert-of-a-long-history-2', 'near', 'warning', 'resolved', 'r2', 'front', 'box', 'box is near', 1764066666666666666, 1764733333333333326);
INSERT INTO public.disagreements VALUES ('r0', 'front', 'box', 1764000000000000000, 1764666666666666660, false, 1, 'm', 2, 'n');
INSERT INTO public.disagreements VALUES ('r1', 'front', 'box', 1764033333333333333, 1764699999999999993, false, 1, 'm', 2, 'n');
INSERT INTO public.disagreements VALUES ('r2', 'front', 'box', 1764066666666666666, 1764733333333333326, false, 1, 'm', 2, 'n');
INSERT INTO public.forgotten VALUES ('gone0', 1764000000000000000);
INSERT INTO public.forgotten VALUES ('gone1', 1764033333333333333);
INSERT INTO public.forgotten VALUES ('gone2', 1764066666666666666);
INSERT INTO public.heartbeat VALUES (1, 1764100000000000000);
INSERT INTO public.intervals VALUES ('r0', 'front', 'box', 1764000000000000000, 1764666666666666660, false, 1, 0.5, 1.25, 1764000000000000000, 'm', 'w');
INSERT INTO public.intervals VALUES ('r1', 'front', 'box', 1764033333333333333, 1764699999999999993, false, 2, 0.5, 1.25, 1764033333333333333, 'm', 'w');
INSERT INTO public.intervals VALUES ('r2', 'front', 'box', 1764066666666666666, 1764733333333333326, false, 3, 0.5, 1.25, 1764066666666666666, 'm', 'w');
INSERT INTO public.object_events VALUES ('hall', 'o0', 'moved', 1764000000000000000, 1764000000000000000, false, 'box', 1.5, 2.5, 3.5, 4.5, '', 'r1');
INSERT INTO public.object_events VALUES ('hall', 'o1', 'moved', 1764033333333333333, 1764033333333333333, false, 'box', 1.5, 2.5, 3.5, 4.5, '', 'r1');
INSERT INTO public.object_events VALUES ('hall', 'o2', 'moved', 1764066666666666666, 1764066666666666666, false, 'box', 1.5, 2.5, 3.5, 4.5, '', 'r1');
INSERT INTO public.poses VALUES ('r0', 1.5, 2.5, 0.5, 1764000000000000000);
INSERT INTO public.poses VALUES ('r1', 1.5, 2.5, 0.5, 1764033333333333333);
INSERT INTO public.poses VALUES ('r2', 1.5, 2.5, 0.5, 1764066666666666666);
INSERT INTO public.presence VALUES ('r0', 'front', 1764000000000000000, 1764666666666666660, false, NULL);
INSERT INTO public.presence VALUES ('r1', 'front', 1764033333333333333, 1764699999999999993, false, NULL);
INSERT INTO public.presence VALUES ('r2', 'front', 1764066666666666666, 1764733333333333326, false, NULL);
INSERT INTO public.schema_version VALUES (1, 1);
INSERT INTO public.stock VALUES ('hall', 'zone 0', 'box', 1764000000000000000, 1764666666666666660, false, 0);
INSERT INTO public.stock VALUES ('hall', 'zone 1', 'box', 1764033333333333333, 1764699999999999993, false, 1);
INSERT INTO public.stock VALUES ('hall', 'zone 2', 'box', 1764066666666666666, 1764733333333333326, false, 2);
INSERT INTO public.users VALUES ('ann', 'operator', '$argon2id$v=19$m=19456,t=2,p=1$OzGZAh6DsjNxGEBrPjV+Gg$bMMAKgqArsBfXYIcdwkZotgZNi8nRd5QeuAqqFvwfwo', 1764100000000000000);
ALTER TABLE ONLY public.acts
    ADD CONSTRAINT acts_pkey PRIMARY KEY (alert_id, at_ns, state);
ALTER TABLE ONLY public.alert_objects
    ADD CONSTRAINT alert_objects_pkey PRIMARY KEY (alert_id);
ALTER TABLE ONLY public.alerts
    ADD CONSTRAINT alerts_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.clock_correction
    ADD CONSTRAINT clock_correction_pkey PRIMARY KEY (name, from_ns);
ALTER TABLE ONLY public.clock_doubt
    ADD CONSTRAINT clock_doubt_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.disagreements
    ADD CONSTRAINT disagreements_pkey PRIMARY KEY (robot, camera, name, since_ns);
ALTER TABLE ONLY public.forgotten
    ADD CONSTRAINT forgotten_pkey PRIMARY KEY (robot);
ALTER TABLE ONLY public.heartbeat
    ADD CONSTRAINT heartbeat_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.intervals
    ADD CONSTRAINT intervals_pkey PRIMARY KEY (robot, camera, name, since_ns);
ALTER TABLE ONLY public.logins
    ADD CONSTRAINT logins_pkey PRIMARY KEY (digest);
ALTER TABLE ONLY public.object_events
    ADD CONSTRAINT object_events_pkey PRIMARY KEY (site, object, kind, since_ns);
ALTER TABLE ONLY public.poses
    ADD CONSTRAINT poses_pkey PRIMARY KEY (robot);
ALTER TABLE ONLY public.presence
    ADD CONSTRAINT presence_pkey PRIMARY KEY (robot, camera, since_ns);
ALTER TABLE ONLY public.schema_version
    ADD CONSTRAINT schema_version_pkey PRIMARY KEY (id);
ALTER TABLE ONLY public.stock
    ADD CONSTRAINT stock_pkey PRIMARY KEY (site, zone, name, since_ns);
ALTER TABLE ONLY public.users
    ADD CONSTRAINT users_pkey PRIMARY KEY (name);
ALTER TABLE ONLY public.webhook_backlog
    ADD CONSTRAINT webhook_backlog_pkey PRIMARY KEY (webhook, alert_id);
CREATE INDEX alerts_by_change ON public.alerts USING btree (changed_ns);
CREATE INDEX alerts_open ON public.alerts USING btree (changed_ns) WHERE ((state)::text <> 'resolved'::text);
CREATE INDEX disagreements_by_end ON public.disagreements USING btree (until_ns);
CREATE INDEX disagreements_open ON public.disagreements USING btree (since_ns) WHERE open;
CREATE INDEX intervals_by_end ON public.intervals USING btree (until_ns);
CREATE INDEX intervals_open ON public.intervals USING btree (since_ns) WHERE open;
CREATE INDEX logins_by_user ON public.logins USING btree ("user");
CREATE INDEX object_events_by_end ON public.object_events USING btree (until_ns);
CREATE INDEX object_events_open ON public.object_events USING btree (since_ns) WHERE open;
CREATE INDEX presence_by_end ON public.presence USING btree (until_ns);
CREATE INDEX presence_open ON public.presence USING btree (since_ns) WHERE open;
CREATE INDEX stock_by_end ON public.stock USING btree (until_ns);
CREATE INDEX stock_open ON public.stock USING btree (since_ns) WHERE open;
