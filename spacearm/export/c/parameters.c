const ${name}_parameters ${name}_nominal = {
$values
};
