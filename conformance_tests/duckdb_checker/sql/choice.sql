-- The canonical choice: one attempt for each action key of a group (spec/07-rules.md#canonical-choice).
create or replace temp table candidate as
select run, r.rollout_id, group_id, role, action_key, protocol_variant, attempt, nominal_rollout_id,
    f.rollout_id is not null as faulty, f.rollout_id is null and q.rollout_id is null as complies
from rollouts r
left join (select distinct rollout_id from faulty) f using (rollout_id)
left join (select distinct rollout_id from failed) q using (rollout_id)
where status = 'complete' and role in ('nominal', 'intervention')
    and group_id not in (select group_id from faulty_group);

create or replace temp table variant_nominal as
select *, complies as stands from candidate where role = 'nominal'
qualify row_number() over (partition by group_id, protocol_variant order by complies desc, attempt, rollout_id) = 1;

create or replace temp table variant_choice as
select * from variant_nominal
union all
select c.*, c.complies and c.nominal_rollout_id is not distinct from n.rollout_id as stands
from candidate c left join variant_nominal n using (group_id, protocol_variant)
where c.role = 'intervention'
qualify row_number() over (
    partition by c.group_id, c.protocol_variant, c.action_key order by stands desc, c.attempt, c.rollout_id) = 1;

create or replace temp table group_variant as
select group_id, protocol_variant
from variant_choice
group by group_id, protocol_variant
qualify row_number() over (
    partition by group_id
    order by bool_or(role = 'nominal') desc, count(*) filter (stands) desc, count(*) desc, encode(protocol_variant)) = 1;

create or replace temp table chosen_nominal as
select * from variant_nominal semi join group_variant using (group_id, protocol_variant);

create or replace temp table chosen as
select c.*, g.protocol_variant <> c.protocol_variant as strange
from variant_choice c join group_variant g using (group_id)
qualify row_number() over (
    partition by c.group_id, c.action_key order by strange, stands desc, c.attempt, c.rollout_id) = 1;

-- Chosen interventions beside their chosen nominal, without attempts that break a structure rule.
create or replace temp table chosen_pair as
select c.run, n.run as nominal_run
from chosen c join chosen_nominal n using (group_id)
where c.role = 'intervention' and not c.faulty and not n.faulty;

create or replace temp table branch_group as
select distinct group_id from rollouts where group_id not in (select group_id from faulty_group);

-- Groups that rules on groups examine: no chosen attempt breaks a structure rule.
create or replace temp table examined_group as
select group_id from branch_group where group_id not in (select group_id from chosen where faulty);

create or replace temp table examined_nominal as
select * from chosen_nominal semi join examined_group using (group_id);

create or replace temp table examined_pair as
select * from chosen_pair where nominal_run in (select run from examined_nominal);

-- Those of them with a chosen intervention to compare with.
create or replace temp table compared_nominal as
select * from examined_nominal where run in (select nominal_run from chosen_pair);
