create or replace macro wrap(angle) as angle - 2 * pi() * round_even(angle / (2 * pi()), 0);

create or replace macro nearly_all(part, whole, fewest) as whole >= fewest and part >= 0.9 * whole;

-- Distance of a point (x, y), in the frame of a box, from the filled box.
create or replace macro beyond_box(x, y, length, width) as
    sqrt(pow(greatest(abs(x) - length / 2, 0), 2) + pow(greatest(abs(y) - width / 2, 0), 2));

