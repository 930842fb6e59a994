const ${name}_servo_limits ${name}_servo_nominal = {
$values
};

void ${name}_servo_begin(const double q[$N], ${name}_servo_memory *memory)
{
$start
}

void ${name}_servo_step(const ${name}_servo_seen *seen, const ${name}_servo_limits *limits,
                        ${name}_servo_memory *memory, ${name}_servo_tick *tick)
{
    ${name}_servo_memory next;
$body
    *memory = next;
}
