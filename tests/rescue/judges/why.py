import sys
f,key=sys.argv[1],sys.argv[2]
n=-1;pos=None;pt=None
for l in open(f):
    w=l.split(None,4)
    if len(w)<3 or not w[1].endswith(key): continue
    if w[0]=='P': pos=l.split()[3:6]; continue
    if w[0]=='E' and w[3]=='Log':
        if ' B ' in l: n+=1; print('--- search %d (%s) at t %s true %s %s believed %s'%(n,chr(65+n),w[2],pos[0],pos[1],' '.join(l.split()[5:8])))
        elif ' R ' in l: print('   t %s true %s %s %.0f | %s'%(w[2],pos[0],pos[1],float(pos[2])*57.3,l.split(' R ')[1].strip()))
    elif 'Engine(Dock)' in l or 'may drive' in l: print('   t %s %s'%(w[2],l.split(None,3)[3].strip()[:90]))
