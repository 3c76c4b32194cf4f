import pickle,sys,subprocess,os
fn,out=sys.argv[1:3]
subprocess.run(['python3','qs.py',fn],stdout=subprocess.DEVNULL)
o=pickle.load(open('/tmp/qs.pkl','rb'));os.replace('/tmp/qs.geo',out+'.geo')
by={}
for s in o: by.setdefault(s['key'],[]).append(s)
f=open(out,'w')
for k,v in by.items():
    f.write('K %s\n'%k)
    for s in v:
        rows=sorted(s['rows'])
        x,y,h=s['true']
        f.write('S 0 0 0 0 0 0 %g %g %g %d %s\n'%(x,y,h,len(rows),' '.join('%g %g %d %g 1.3'%(r[0],r[1],1 if r[2]=='k' else 0,r[1] if r[2]=='k' else .1) for r in rows)))
