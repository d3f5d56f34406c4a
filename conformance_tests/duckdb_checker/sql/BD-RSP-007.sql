-- subjects: (select 1 from calibration group by "table", "column" having count(*) >= 8)
select "table", "column" from calibration
group by "table", "column" having nearly_all(count(*) filter (not value between least and most), count(*), 8)
