-- subjects: rollouts where len($scenario_types) > 0
select distinct 'branchdrive.json' as file, '/collection/scenario_types' as pointer
from rollouts where len($scenario_types) > 0 and not list_contains($scenario_types, scenario_type)
