-- subjects: (select 1 from calibration group by quantity having count(*) >= 8)
select "table", "column" from calibration
group by quantity, "table", "column" having nearly_all(count(*) filter (not value between least and most), count(*), 8)
